"""Each algebraic system on its own clean rendered markers: 95 % of their circles at 20 px of semi-axis."""

import pyarrow.parquet as pq
import pytest

from roundel.render.run import render_study
from roundel.solver.estimates import ESTIMATES
from roundel.solver.methods.solve import solve_dataset

STUDY = """\
schema: 1
name: related
seed: 3
camera: {{width_px: 640, height_px: 480, focal_px: 640}}
marker: {marker}
pose:
  distance_m: {distance}
  tilt_deg: {{uniform: [15, 55]}}
  azimuth_deg: {{uniform: [-180, 180]}}
  offset_x_px: {{uniform: [-60, 60]}}
  offset_y_px: {{uniform: [-40, 40]}}
sensor: {{full_well_e: 10000, read_noise_e: 5}}
render: {{target_error: 0.01, radiance: false}}
frames: 24
"""
# Radius / distance is 20 px over the focal length.
PRINTS = {
    "disc": ("{kind: disc, diameter_m: 0.08}", 1.28, ["wu2004", "szpak2015"]),
    "two_discs": (
        "{kind: two_discs, diameter_m: 0.04, second_diameter_m: 0.04, spacing_m: 0.06}",
        0.64,
        ["wu2004", "chen2004", "gurdjos2006"],
    ),
    "ring": ("{kind: ring, diameter_m: 0.08, inner_diameter_m: 0.04}", 1.28, ["kim2005", "huang2015"]),
    "dot_ring": (
        "{kind: dot_ring, diameter_m: 0.02, ring_diameter_m: 0.08, dots: 6}",
        0.32,
        ["chen2004", "gurdjos2006", "pollefeys1999"],
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", PRINTS)
def test_95_percent_are_found_at_20_px(kind, tmp_path):
    marker, distance, methods = PRINTS[kind]
    study = tmp_path / "study.yaml"
    study.write_text(STUDY.format(marker=marker, distance=distance), encoding="utf-8")
    render_study(study, tmp_path / "dataset")
    solve_dataset(tmp_path / "dataset", tmp_path / "estimates", methods=methods)
    printed = pq.read_table(tmp_path / "dataset" / "truth.parquet").num_rows
    rows = pq.read_table(tmp_path / "estimates" / ESTIMATES).to_pylist()
    for method in methods:
        posed = {
            (row["frame_id"], row["detection_id"])
            for row in rows
            if row["method"] == method and row["status"] == "ok" and row["normal_x"] is not None
        }
        assert len(posed) >= 0.95 * printed, method
        focal = [row for row in rows if row["method"] == method and row["focal_px"] is not None]
        if method not in ("wu2004", "szpak2015"):
            # At 20 px two discs 1.5 diameters apart measure it to some percent: none is wrong by more than 4 sigma.
            assert len({row["frame_id"] for row in focal}) >= 0.8 * 24, method
            assert all(abs(row["focal_px"] - 640.0) < 4.0 * row["focal_sigma_px"] + 1.0 for row in focal), method
