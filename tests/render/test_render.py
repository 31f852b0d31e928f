"""Mitsuba's renders against theory: the analytic edge, the radiometry, the lens."""

from pathlib import Path

import numpy as np
import pytest
from helpers_studies import small_study
from scipy.stats import t as student

from roundel.datasets.fidelity.measure import measure_circle
from roundel.datasets.fidelity.summary import summarise
from roundel.datasets.layout.radiance import REPLICATES
from roundel.render.radiance import render_radiance
from roundel.render.rays.sample_allocation import sample_map
from roundel.render.scene.transport import is_plain
from roundel.scenes.camera.model import project
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.truth.truth import truth_of
from roundel.scenes.world.frame import frame_of, frames_of

SMALL_LIGHT = "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}\n"
FLAT = (
    "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}",
    "light: {environment: 1.5}",
)
DISTORTED = ("focal_px: 320", "focal_px: 320, distortion: [-0.3, 0.1, 0.004, -0.003, 0.02]")


@pytest.mark.parametrize("edits", [(), (FLAT,), (DISTORTED,)], ids=["lamp", "constant", "distorted"])
def test_a_rendered_disc_lies_on_its_analytic_contour(mi, tmp_path: Path, edits) -> None:
    study = small_study(tmp_path, *edits, ("band_samples: 256", "band_samples: 1024"))
    measured = []
    for frame in frames_of(study):
        radiance = render_radiance(mi, frame)
        found = measure_circle(frame, 0, radiance.mean, radiance.variance)
        assert found is not None
        measured.append(found)
    summary = summarise(measured)
    for key in ("shift_x_px", "shift_y_px", "scale_px"):
        # What the project promises of a sharp disc; an offset of half a pixel would be a hundred times that.
        assert summary[key]["worst"] < 0.005
    # The lamps' own sampling noise is part of the recorded variance: what is left at the edge is that and no more. The
    # ratio of two RMS over some 4,000 pixels scatters by 1 to 2 %; heavy tails at the edge widen it.
    assert summary["residual"] / summary["monte_carlo"] == pytest.approx(1.0, abs=0.1)


COARSE = ("band_samples: 256", "target_error: 0, band_samples: 1024")
FINE = ("band_samples: 256", "target_error: 0, samples: 1024, band_samples: 16384")


def coarse_and_fine(mi, folder: Path, *edits):
    """The same frame with 1,024 and with 16,384 samples a pixel in the band, and the band."""
    frame = frame_of(small_study(folder, *edits, COARSE), 0)
    fine = render_radiance(mi, frame_of(small_study(folder, *edits, FINE, name="fine.yaml"), 0))
    return render_radiance(mi, frame), fine, sample_map(frame).edge


def test_edge_pixels_pass_a_t_test_against_a_finer_render(mi, tmp_path: Path) -> None:
    coarse, fine, band = coarse_and_fine(mi, tmp_path, FLAT)
    # Where the edge only grazes a pixel, a replicate of 132 samples meets it a few times only: nothing Gaussian there.
    edge = band & (fine.coverage[0] > 0.05) & (fine.coverage[0] < 0.95)
    t = (coarse.mean - fine.mean)[edge] / np.sqrt(coarse.variance + fine.variance)[edge]
    # Student's t with 7 degrees of freedom, Sidak over the pixels.
    limit = student.ppf(1 - (1 - (1 - 0.01) ** (1 / edge.sum())) / 2, REPLICATES - 1)
    assert edge.sum() > 90
    assert np.abs(t).max() < limit
    # Neither flattered nor inflated: t^2 has the mean 7/5; over a hundred pixels it scatters by some 25 %.
    assert np.mean(t**2) == pytest.approx(7 / 5, rel=0.5)


def test_the_recorded_variance_is_that_of_the_error_under_lamps_too(mi, tmp_path: Path) -> None:
    coarse, fine, band = coarse_and_fine(mi, tmp_path)
    error = (coarse.mean.astype(float) - fine.mean)[band]
    predicted = (coarse.variance.astype(float) + fine.variance)[band]
    # Over the 700 pixels of the band; pixel by pixel a lamp that few rays meet is too rare an event for a t-test.
    assert np.mean(error**2) / np.mean(predicted) == pytest.approx(1.0, abs=0.2)


def test_radiance_of_a_diffuse_sheet_under_a_constant_sky_is_reflectance_times_sky(mi, tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, FLAT), 0)
    radiance = render_radiance(mi, frame)
    inside, far = radiance.coverage[0] == 1, np.zeros_like(radiance.mean, dtype=bool)
    far[:2, :2] = True  # a corner of the wall
    # L = rho L_sky for a Lambertian plane that sees nothing but sky; float32 has seven digits.
    np.testing.assert_allclose(radiance.mean[inside], 0.05 * 1.5, rtol=1e-5)
    np.testing.assert_allclose(radiance.mean[far], 0.35 * 1.5, rtol=1e-5)
    assert radiance.variance[inside].max() < 1e-12


def test_coverage_and_depth_agree_with_the_truth(mi, tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path), 1)
    radiance, row = render_radiance(mi, frame), truth_of(frame)[0]
    area = np.pi * row["ellipse_a_px"] * row["ellipse_b_px"]
    # Coverage of some 130 edge pixels at 256 samples each: 130^0.5 * 0.03.
    assert radiance.coverage[0].sum() == pytest.approx(area, abs=0.4)
    u, v = round(row["centre_image_x_px"]), round(row["centre_image_y_px"])
    # Within half a pixel of the centre, depth changes by the tilt: 0.7 px / 320 px * distance * tan 50.
    assert radiance.depth_m[v, u] == pytest.approx(row["centre_z_m"], rel=0.003)


def test_a_thin_lens_blurs_by_its_circle_of_confusion(mi, tmp_path: Path) -> None:
    edits = (FLAT, ("focal_px: 320", "focal_px: 320, aperture_mm: 30, focus_m: 0.45"), ("{uniform: [10, 50]}", "0"))
    frame = frame_of(small_study(tmp_path, *edits, ("{uniform: [7, 9]}", "9")), 0)
    radiance, row = render_radiance(mi, frame), truth_of(frame)[0]
    # Second moment of the disc's image = that of the sharp disc + blur (variances add): per axis R^2/4 + b^2.
    y, x = np.mgrid[: frame.camera.height_px, : frame.camera.width_px]
    w = radiance.coverage[0].astype(float)
    w /= w.sum()
    cx, cy = (w * x).sum(), (w * y).sum()
    moment = (w * ((x - cx) ** 2 + (y - cy) ** 2)).sum() / 2
    sharp = row["ellipse_a_px"] ** 2 / 4
    # Off axis the blur disc is the same for a plane parallel to the image; 2 % is the Monte-Carlo error of the moment.
    assert np.sqrt(moment - sharp) == pytest.approx(row["edge_blur_px"], rel=0.02)
    assert row["edge_blur_px"] > 2


def test_a_chessboard_has_its_ink_where_its_layout_says(mi, tmp_path: Path) -> None:
    edits = (
        ("kind: disc, diameter_m: 0.08", "kind: chessboard, columns: 4, rows: 3, square_m: 0.03"),
        ("distance_D: {uniform: [7, 9]}", "distance_m: 0.6"),
        FLAT,
    )
    frame = frame_of(small_study(tmp_path, *edits), 0)
    mean = render_radiance(mi, frame).mean
    for column in range(5):
        for row in range(4):
            middle = [(column - 2) * 0.03, (1.5 - row) * 0.03, 0.0]
            u, v = np.rint(project(frame.camera, transform_points(frame.camera_from_sheet, middle))).astype(int)
            # The top-left square (min X, max Y) is ink.
            assert mean[v, u] == pytest.approx(1.5 * (0.05 if (column + row) % 2 == 0 else 0.80), rel=1e-5)


def test_a_ring_has_paper_within(mi, tmp_path: Path) -> None:
    frame = frame_of(small_study(tmp_path, ("kind: disc", "kind: ring, inner_diameter_m: 0.04"), FLAT), 0)
    radiance, row = render_radiance(mi, frame), truth_of(frame)[0]
    u, v = round(row["centre_image_x_px"]), round(row["centre_image_y_px"])
    assert radiance.mean[v, u] == pytest.approx(0.8 * 1.5, rel=1e-5)
    assert row["radius_m"] == 0.04


LENS = ("focal_px: 320", "focal_px: 320, aperture_mm: 12, focus_m: 0.4")
MOTION = ("light:", "motion: {exposure_s: 0.02, camera: {rate_deg_s: [0, 40, 0]}}\nlight:")
AIRY = ("focal_px: 320", "focal_px: 320, aperture_mm: 0.15, focus_m: 0.64, diffraction: true")


@pytest.mark.parametrize("edits", [(), (LENS,), (MOTION,), (AIRY,)], ids=["sharp", "defocus", "motion", "diffraction"])
def test_the_target_error_is_reached_and_not_overshot(mi, tmp_path: Path, edits) -> None:
    frame = frame_of(small_study(tmp_path, FLAT, *edits, ("band_samples: 256", "target_error: 0.01")), 0)
    radiance = render_radiance(mi, frame)
    edge = sample_map(frame).edge & (radiance.coverage[0] > 0.02) & (radiance.coverage[0] < 0.98)
    error = np.sqrt(radiance.variance[edge].mean()) / radiance.mean.max()
    # Counts are rounded up, and a pilot of 8 replicates is a rough one: between half the target and a fifth more.
    assert 0.005 < error < 0.012


def test_more_is_asked_where_more_is_seen(mi, tmp_path: Path) -> None:
    errors = []
    for target in ("0.02", "0.005"):
        frame = frame_of(small_study(tmp_path, FLAT, ("band_samples: 256", f"target_error: {target}")), 0)
        radiance = render_radiance(mi, frame)
        errors.append(np.sqrt(radiance.variance[sample_map(frame).edge].mean()))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.35)


def test_the_closed_form_agrees_with_mitsubas_integrator(mi, tmp_path: Path, monkeypatch) -> None:
    from roundel.render import radiance as module

    edits = (("band_samples: 256", "target_error: 0, samples: 512, band_samples: 512"),)
    frame = frame_of(small_study(tmp_path, *edits), 0)
    assert module.is_plain(frame)
    ours = render_radiance(mi, frame)
    monkeypatch.setattr(module, "is_plain", lambda _: False)
    theirs = render_radiance(mi, frame)
    error = ours.mean.astype(float) - theirs.mean
    spread = np.sqrt(ours.variance.astype(float) + theirs.variance)
    # The mean of the whole frame: 1e-5 for float32 over 19,200 pixels, beside its own standard error.
    assert abs(error.mean()) < 1e-5 * ours.mean.mean() + 4 * np.sqrt(np.sum(spread**2)) / spread.size
    # Pixel by pixel the lamp that few of Mitsuba's rays meet is no Gaussian event: by RMS.
    assert np.sqrt(np.mean(error**2) / np.mean(spread**2)) == pytest.approx(1.0, abs=0.15)
    # The lamp in closed form has a fraction of the noise.
    assert ours.variance.mean() < theirs.variance.mean()


def test_a_point_lamp_in_closed_form_agrees_with_mitsubas(mi, tmp_path: Path, monkeypatch) -> None:
    from roundel.render import radiance as module

    point = (
        "light: {environment: 0.7, lamps: [{position_m: [-0.3, -0.5, 0.0], size_m: 0.2, radiance: 6}]}",
        "light: {environment: 0.2, lamps: [{kind: point, position_m: [-0.3, -0.5, 0.0], intensity: 1.5}]}",
    )
    frame = frame_of(small_study(tmp_path, point), 0)
    assert module.is_plain(frame)
    ours = render_radiance(mi, frame)
    monkeypatch.setattr(module, "is_plain", lambda _: False)
    theirs = render_radiance(mi, frame)
    smooth = ~(sample_map(frame).edge | sample_map(frame).border)
    # Neither has noise where the print is even, but the wall's brightness changes within a pixel: to 1e-3.
    np.testing.assert_allclose(ours.mean[smooth], theirs.mean[smooth], rtol=2e-3)


@pytest.mark.parametrize(
    "edit",
    [
        "light: {sky: {}}\nmarker: {surface: {kind: plastic}, ",
        "occluders: [{z_m: 0.1, x_m: 0.1, width_m: 0.02}]\nmarker: {",
        "light: {environment: 1, lamps: [{position_m: [0.1, 0, 0.5], size_m: 0.1, radiance: 1}]}\nmarker: {",
    ],
    ids=["gloss under a sky", "occluder", "lamp in the picture"],
)
def test_what_the_closed_form_cannot_do_goes_through_mitsuba(tmp_path: Path, edit) -> None:
    edits = [("marker: {", edit)]
    if "light" in edit:
        edits.append((SMALL_LIGHT, ""))
    assert not is_plain(frame_of(small_study(tmp_path, *edits), 0))
    assert is_plain(frame_of(small_study(tmp_path, name="plain.yaml"), 0))
