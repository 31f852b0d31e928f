"""`roundel develop`: another sensor for existing radiance, without rendering; and flags."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_studies import SMALL, small_study

from roundel.cli.main import main
from roundel.datasets.dataset import open_dataset
from roundel.datasets.layout import files
from roundel.datasets.layout.images import open_images
from roundel.datasets.layout.radiance import read_radiance
from roundel.render.redevelop import develop_dataset
from roundel.render.run import render_study
from roundel.scenes.errors import DataError, StudyError, UsageError
from roundel.scenes.study.sensor_file import study_with_sensor
from roundel.scenes.study.study import load_study

TWO = ("frames: 4", "frames: 2\nsensor: {full_well_e: 9000, exposure_ph: 20000}")


@pytest.fixture(scope="module")
def rendered(tmp_path_factory) -> Path:
    """Two frames, rendered."""
    folder = tmp_path_factory.mktemp("rendered")
    render_study(small_study(folder, TWO), folder / "ds")
    return folder / "ds"


def sensor_file(folder: Path, text: str) -> Path:
    path = folder / "sensor.yaml"
    path.write_text(text)
    return path


def test_the_same_sensor_gives_the_same_bytes(rendered: Path, tmp_path: Path) -> None:
    again = develop_dataset(rendered, tmp_path / "out", sensor_file(tmp_path, "sensor: {full_well_e: 9000}\n"))
    assert again.verify(full=True) == []
    for path in sorted(p for p in rendered.rglob("*") if p.is_file()):
        name = path.relative_to(rendered)
        if name.name not in (files.TIMINGS, files.MANIFEST):
            assert (tmp_path / "out" / name).read_bytes() == path.read_bytes(), name
    before, after = (json.loads((p / files.MANIFEST).read_text()) for p in (rendered, tmp_path / "out"))
    assert after.pop("developed_from") == before["dataset_id"]
    assert after.pop("sha256") != before.pop("sha256")
    assert after == before


def test_another_sensor_makes_another_complete_dataset(rendered: Path, tmp_path: Path) -> None:
    text = "bits: 12\nblack_level_dn: 60\nread_noise_e: {uniform: [3, 9]}\nexposure_e: 8000\n"
    out = develop_dataset(rendered, tmp_path / "out", sensor_file(tmp_path, text))
    assert out.verify(full=True) == []
    before = open_dataset(rendered)
    assert out.manifest["developed_from"] == before.manifest["dataset_id"] != out.manifest["dataset_id"]
    # The study is the one that would render it; the electrons of the old one gave way to the new.
    study = load_study(tmp_path / "out" / files.STUDY)
    assert study.digest() == out.manifest["dataset_id"]
    assert study.groups["main"].sensor.exposure_ph is None
    for column in ("camera_from_marker_03", "conic_00", "visible_fraction"):
        assert out.truth[column].equals(before.truth[column])
    sensors = [record["sensor"] for record in out.images.records]
    assert sensors[0]["read_noise_e"] != sensors[1]["read_noise_e"]
    assert all(3 <= s["read_noise_e"] <= 9 and s["stored_shift"] == 4 for s in sensors)
    assert out.images.image(0).dtype == np.uint16
    planes, old = (read_radiance(p / files.radiance_name(0)) for p in (tmp_path / "out", rendered))
    assert set(planes) == set(old) == {"Y", "Y.variance", "Z", "coverage.0", "noise_dn"}
    np.testing.assert_array_equal(planes["Y"], old["Y"])
    assert (planes["noise_dn"] > 10 * old["noise_dn"]).all()


def test_it_is_what_rendering_with_that_sensor_would_have_made(rendered: Path, tmp_path: Path) -> None:
    text = "{full_well_e: 9000, exposure_ph: 20000, curve: srgb, jpeg_quality: 80, prnu: 0.02}"
    study = small_study(tmp_path, ("frames: 4", f"frames: 2\nsensor: {text}"))
    direct = render_study(study, tmp_path / "direct")
    developed = develop_dataset(rendered, tmp_path / "out", sensor_file(tmp_path, text))
    assert direct is not None
    assert developed.manifest["files"] == direct.manifest["files"]
    # And it can be developed again, back to where it came from.
    back = "{curve: linear, jpeg_quality: null, prnu: 0}"
    again = develop_dataset(tmp_path / "out", tmp_path / "back", sensor_file(tmp_path, back))
    assert again.manifest["files"] == open_dataset(rendered).manifest["files"]


def test_processing_and_glare_are_developed_too(tmp_path: Path) -> None:
    lens = ("focal_px: 320", "focal_px: 320, veiling_glare: 0.04, halo: 0.05, halo_px: 10")
    plain = small_study(tmp_path, lens, ("frames: 4", "frames: 1"))
    base = render_study(plain, tmp_path / "base")
    text = "{curve: srgb, isp: phone, jpeg_quality: 90}"
    direct = render_study(small_study(tmp_path, lens, ("frames: 4", f"frames: 1\nsensor: {text}")), tmp_path / "direct")
    developed = develop_dataset(tmp_path / "base", tmp_path / "out", sensor_file(tmp_path, text))
    assert base is not None
    assert direct is not None
    assert developed.manifest["files"] == direct.manifest["files"]
    assert developed.images.records[0]["sensor"]["isp"]["sharpen_amount"] > 0
    # The radiance on disk is the scene's, so that its fidelity is measured without the glare.
    without = render_study(small_study(tmp_path, ("frames: 4", "frames: 1")), tmp_path / "without")
    assert without is not None
    np.testing.assert_array_equal(
        read_radiance(tmp_path / "base" / files.radiance_name(0))["Y"],
        read_radiance(tmp_path / "without" / files.radiance_name(0))["Y"],
    )
    assert without.images.image(0).min() < base.images.image(0).min()
    back = develop_dataset(
        tmp_path / "out", tmp_path / "back", sensor_file(tmp_path, "{curve: linear, isp: none, jpeg_quality: null}")
    )
    assert back.manifest["files"] == base.manifest["files"]


def test_what_a_processor_does_is_not_undone(rendered: Path, tmp_path: Path) -> None:
    # As with photographs: the curve is known, what the camera did besides is not.
    keys = "read_noise_e: 0\nshot_noise: false\ncurve: srgb\n"
    bare = develop_dataset(rendered, tmp_path / "bare", sensor_file(tmp_path, keys)).images
    toned = develop_dataset(rendered, tmp_path / "toned", sensor_file(tmp_path, keys + "isp: {contrast: 0.5}")).images
    from roundel.scenes.camera.srgb import srgb_to_linear

    np.testing.assert_allclose(toned.linear_image(0)[0], 255 * srgb_to_linear(toned.image(0) / 255), rtol=1e-12)
    assert toned.records[0]["sensor"]["curve"] == "srgb"
    assert toned.records[0]["sensor"]["isp"]["contrast"] == 0.5
    assert "isp" not in bare.records[0]["sensor"]


def test_a_curve_is_undone_for_the_solver(rendered: Path, tmp_path: Path) -> None:
    quiet = "read_noise_e: 0\nshot_noise: false\nbits: 16\n"
    linear = develop_dataset(rendered, tmp_path / "linear", sensor_file(tmp_path, quiet)).images
    for curve in ("srgb", "gamma"):
        curved = develop_dataset(rendered, tmp_path / curve, sensor_file(tmp_path, quiet + f"curve: {curve}")).images
        assert (curved.image(0) > linear.image(0).astype(int) + 5000).mean() > 0.9
        levels, saturation = curved.linear_image(0)
        # Rounded to 16 bits twice.
        np.testing.assert_allclose(levels, linear.image(0), atol=2)
        assert saturation == pytest.approx(65535)
    assert linear.linear_image(0)[0].dtype == np.uint16


def test_a_development_resumes(rendered: Path, tmp_path: Path) -> None:
    sensor = sensor_file(tmp_path, "bits: 10\n")
    develop_dataset(rendered, tmp_path / "out", sensor)
    listed = open_dataset(tmp_path / "out").manifest
    kept = (tmp_path / "out" / files.image_name(0)).stat().st_mtime_ns
    (tmp_path / "out" / files.image_name(1)).unlink()
    (tmp_path / "out" / files.MANIFEST).unlink()
    assert develop_dataset(rendered, tmp_path / "out", sensor).manifest == listed
    assert (tmp_path / "out" / files.image_name(0)).stat().st_mtime_ns == kept
    with pytest.raises(UsageError, match="another study"):
        develop_dataset(rendered, tmp_path / "out", sensor_file(tmp_path, "bits: 12\n"))
    with pytest.raises(UsageError, match="is the dataset itself"):
        develop_dataset(rendered, rendered, sensor_file(tmp_path, "{}"))


def test_without_hard_links_radiance_is_copied(rendered: Path, tmp_path: Path, monkeypatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError("another disk")

    monkeypatch.setattr(os, "link", refuse)
    assert develop_dataset(rendered, tmp_path / "out", sensor_file(tmp_path, "{}")).verify(full=True) == []


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("bits: 12\nred_noise_e: 3\n", 2, 1, "unknown key; did you mean read_noise_e"),
        ("sensor:\n  bits: 9\n", 2, 3, "8, 10, 12 or 16"),
        ("read_noise_e: -1", 1, 1, "must not be negative"),
        ("read_noise_e: nan\nbits: 12", 1, 1, "'nan' is not a number"),
        ("\nmosaic: rggb", 2, 1, "mosaic: determines which rays are traced"),
        ("fill_factor: 0.5", 1, 1, "fill_factor: determines which rays are traced"),
        ("prnu: {grid: [0, 0.1]}", 1, 1, "a grid determines the number of frames"),
        ("isp: {contrast: {grid: [0, 0.1]}}", 1, 1, "a grid determines the number of frames"),
        ("bits: 8\nisp: fone", 2, 1, "'none' or 'phone', not 'fone'"),
        ("exposure_e: 3\nexposure_ph: 3", 1, 1, "not both"),
        ("white_level: 0.5", 1, 1, "fixed exposure; add `exposure_ph: null`"),
        ("nonsense: null", 1, 1, "unknown key"),
        ("\n- 3", 2, 1, "a mapping with the keys"),
        ("sensor: 3", 1, 1, "a mapping with the keys"),
        ("bits: [", 1, 8, "not YAML"),
        ("bits: 12\njpeg_quality: 80", 1, 1, "a JPEG has 8 bits"),
    ],
)
def test_what_cannot_be_developed_is_said_at_its_place(
    rendered: Path, tmp_path: Path, text: str, line: int, column: int, words: str
) -> None:
    with pytest.raises(StudyError, match=r".") as caught:
        develop_dataset(rendered, tmp_path / "out", sensor_file(tmp_path, text))
    assert words in str(caught.value)
    assert (caught.value.line, caught.value.column) == (line, column)
    assert not (tmp_path / "out").exists()


def test_a_swept_key_keeps_its_levels(tmp_path: Path) -> None:
    swept = "frames: 2\nsweep: {key: sensor.read_noise_e, levels: [2, 20]}"
    study = small_study(tmp_path, ("frames: 4", swept))
    with pytest.raises(StudyError, match="read_noise_e: is swept in group main"):
        study_with_sensor(study, sensor_file(tmp_path, "read_noise_e: 3"))
    other = study_with_sensor(study, sensor_file(tmp_path, "full_well_e: 5000"))
    assert other.groups["main"].sweep == study.groups["main"].sweep
    assert other.groups["main"].sensor.full_well_e == 5000


def test_radiance_that_is_not_there_is_missed(rendered: Path, tmp_path: Path) -> None:
    sensor = sensor_file(tmp_path, "bits: 12")
    render_study(small_study(tmp_path, ("256}", "256, radiance: false}"), ("frames: 4", "frames: 1")), tmp_path / "no")
    with pytest.raises(UsageError, match=r"without its radiance.*render\.radiance: true"):
        develop_dataset(tmp_path / "no", tmp_path / "out", sensor)
    shutil.copytree(rendered, tmp_path / "damaged")
    path = tmp_path / "damaged" / files.radiance_name(1)
    path.unlink()
    with pytest.raises(DataError, match="is missing"):
        develop_dataset(tmp_path / "damaged", tmp_path / "out", sensor)
    shutil.copy(rendered / files.radiance_name(0), path)
    with pytest.raises(DataError, match="were recorded"):
        develop_dataset(tmp_path / "damaged", tmp_path / "out", sensor)
    with pytest.raises(DataError, match="no such folder"):
        develop_dataset(tmp_path / "none", tmp_path / "out", sensor)
    points = small_study(tmp_path, ("frames: 4", "frames: 1\nmode: points"))
    render_study(points, tmp_path / "points")
    with pytest.raises(UsageError, match="nothing to develop"):
        develop_dataset(tmp_path / "points", tmp_path / "out2", sensor)


def test_developing_needs_no_renderer(rendered: Path, tmp_path: Path) -> None:
    sensor_file(tmp_path, "bits: 16")
    script = (
        "import sys; sys.modules['mitsuba'] = None; sys.modules['drjit'] = None;"
        "from roundel.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", script, "develop", str(rendered), str(tmp_path / "out")]
    command += ["--sensor", str(tmp_path / "sensor.yaml")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "2 frames" in done.stdout
    assert f"developed from {open_dataset(rendered).manifest['dataset_id'][:12]}" in done.stdout
    assert "warning" not in done.stderr


def test_wrong_arguments_are_one_line(rendered: Path, tmp_path: Path, capsys) -> None:
    def refused(code: int, words: str, *arguments: object) -> None:
        try:
            got = main(["develop", *map(str, arguments)])
        except SystemExit as stop:  # argparse's own
            got = int(stop.code or 0)
        said = capsys.readouterr().err
        assert got == code, said
        assert words in said.strip().splitlines()[-1]
        assert "Traceback" not in said

    out, none = tmp_path / "out", tmp_path / "none.yaml"
    refused(2, "--sensor", rendered, out)
    refused(2, f"{none}:1:1: cannot read", rendered, out, "--sensor", none)
    refused(4, f"{tmp_path / 'no'}: not a dataset", tmp_path / "no", out, "--sensor", none)
    sensor = sensor_file(tmp_path, "fill_factor: 0.9")
    refused(2, f"{sensor}:1:1: fill_factor: determines which rays", rendered, out, "--sensor", sensor)


def test_burnt_out_and_dark_frames_are_flagged_and_said(rendered: Path, tmp_path: Path, capsys) -> None:
    for exposure, flag in ((1e8, "saturated"), (1e-3, "dark")):
        sensor_file(tmp_path, f"exposure_e: {exposure}")
        out = tmp_path / flag
        assert main(["develop", str(rendered), str(out), "--sensor", str(tmp_path / "sensor.yaml")]) == 0
        said = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
        assert said == [
            f"roundel: warning: 2 of 2 frames show little or nothing (2 {flag}); the first is frame 0, {flag}"
        ]
        assert pq.read_table(out / files.TRUTH)["flags"].to_pylist() == [flag, flag]
        counts = json.loads((out / files.MANIFEST).read_text())["counts"]["flags"]
        assert counts == {"saturated": 0, "dark": 0, "occluded": 0, flag: 2}


def test_a_render_of_some_frames_warns_at_once(tmp_path: Path, capsys) -> None:
    (tmp_path / "study.yaml").write_text(SMALL.replace("frames: 4", "frames: 4\nsensor: {exposure_e: 1e8}"))
    assert main(["render", str(tmp_path / "study.yaml"), str(tmp_path / "ds"), "--frames", "1:2"]) == 0
    said = capsys.readouterr()
    assert "1 of 1 frames show little or nothing (1 saturated); the first is frame 1" in said.err
    assert "some frames are missing" in said.out


def test_a_colour_jpeg_goes_all_the_way(tmp_path: Path) -> None:
    study = small_study(
        tmp_path, ("frames: 4", "frames: 2\nsensor: {mosaic: grbg, curve: srgb, jpeg_quality: 92, white_level: 0.7}")
    )
    dataset = render_study(study, tmp_path / "ds", threads=1)
    assert dataset is not None
    assert dataset.verify(full=True) == []
    images = open_images(tmp_path / "ds")
    assert images.records[0]["image"] == "images/000000.jpg"
    assert images.image(0).shape == (120, 160, 3)
    assert min(images.records[0]["sensor"]["white_balance"]) == 1.0
    from roundel.solver.methods.solve import solve_dataset
    from roundel.validate.estimates.reader import read_estimates

    solve_dataset(tmp_path / "ds", tmp_path / "est", methods=("ml",), intrinsics=("true",))
    found = read_estimates(tmp_path / "est" / "estimates.parquet").to_pylist()
    truth = {row["frame_id"]: row for row in dataset.truth.to_pylist()}
    assert len(found) == 4
    for row in found:
        true = truth[row["frame_id"]]
        # Of 20 px, through chroma at half the resolution and a lossy code: tenths of a percent. Left behind its curve
        # the circle would be more than 1 % too small.
        assert row["ellipse_a_px"] == pytest.approx(true["ellipse_a_px"], rel=0.005)


def test_a_marker_behind_something_is_flagged(tmp_path: Path, capsys) -> None:
    hidden = "frames: 4\noccluders: [{x_m: 0.0, y_m: 0.0, z_m: 0.05, width_m: 0.3, height_m: 0.3}]"
    (tmp_path / "study.yaml").write_text(SMALL.replace("frames: 4", hidden.replace("4", "1", 1)))
    assert main(["render", str(tmp_path / "study.yaml"), str(tmp_path / "ds")]) == 0
    assert "1 of 1 frames show little or nothing (1 occluded); the first is frame 0" in capsys.readouterr().err
    dataset = open_dataset(tmp_path / "ds")
    assert dataset.truth["flags"].to_pylist() == ["occluded"]
    assert dataset.truth["visible_fraction"].to_pylist() == [0.0]
    assert json.loads((tmp_path / "ds" / files.JOURNAL).read_text())["flags"] == ["occluded"]
