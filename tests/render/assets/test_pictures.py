"""A folder of pictures on the wall behind the sheet."""

from pathlib import Path

import numpy as np
import pytest
from helpers_assets import LIGHT, arrow, own_study, png_bytes
from helpers_light import radiance_along

from roundel.datasets.fidelity.measure import measure_circle
from roundel.render.radiance import render_radiance
from roundel.scenes.errors import StudyError
from roundel.scenes.geometry.pose import transform_points
from roundel.scenes.study.study import load_study
from roundel.scenes.world.frame import frame_of

FEW = ("render: {band_samples: 256}", "render: {target_error: 0.05, background_error: 0.1}")
EVEN = "light: {environment: 1.0}"


def folder_of(folder: Path, count: int = 3) -> Path:
    place = folder / "walls"
    place.mkdir()
    for i in range(count):
        kind = ("PNG", "JPEG")[i % 2]
        (place / f"{i}.{kind.lower()}").write_bytes(png_bytes(np.full((40, 60, 3), 60 * i + 40, dtype=np.uint8), kind))
    return place


def test_a_picture_is_upright_linear_and_of_its_size(rgb, tmp_path: Path) -> None:
    (tmp_path / "walls").mkdir()
    (tmp_path / "walls" / "arrow.png").write_bytes(png_bytes(arrow(256)))
    roll = ("tilt_deg: {uniform: [10, 50]}", "tilt_deg: {uniform: [10, 50]}\n  roll_deg: 77")
    frame = frame_of(own_study(tmp_path, "{pictures: walls, picture_m: 0.8}", EVEN, FEW, roll), 0)
    pose = frame.surroundings.picture.camera_from_picture
    # Upright for the camera, whatever the sheet's roll: up in the picture is up in the image, along the wall.
    assert pose[1, 1] < -0.5
    assert abs(pose[0, 1]) < 1e-12
    inside = [[-0.2, 0.1, 0], [-0.2, 0.35, 0], [0.35, 0.1, 0]]
    # Beyond its edge the picture goes on as in a mirror: red above red.
    beyond = [[-0.2, 0.45, 0], [-0.2, -0.45, 0]]
    light = radiance_along(rgb, frame, transform_points(pose, np.array(inside + beyond)), 1024)
    # The wall sees the whole sky: it reflects its own colour. 128, 220 and 20 of 255 are 0.2159, 0.7157 and 0.0070.
    np.testing.assert_allclose(light[0], 0.2159, rtol=0.02)
    np.testing.assert_allclose(light[1], [0.7157, 0.0070, 0.0070], rtol=0.02)
    np.testing.assert_allclose(light[2], [0.0070, 0.0070, 0.7157], rtol=0.02)
    np.testing.assert_allclose(light[3], light[1], rtol=0.02)
    np.testing.assert_allclose(light[4], light[0], rtol=0.02)


def test_frames_draw_their_pictures_by_themselves(tmp_path: Path) -> None:
    folder_of(tmp_path)
    study = own_study(tmp_path, "{pictures: walls}", LIGHT, FEW, ("frames: 4", "frames: 40"))
    drawn = [frame_of(study, i).surroundings.picture.index for i in range(40)]
    assert set(drawn) == {0, 1, 2}
    again = load_study(tmp_path / "study.yaml")
    assert [frame_of(again, i).surroundings.picture.index for i in range(39, -1, -1)] == drawn[::-1]
    plain = own_study(tmp_path, "plain", LIGHT, FEW, ("frames: 4", "frames: 40"))
    np.testing.assert_array_equal(frame_of(study, 7).camera_from_sheet, frame_of(plain, 7).camera_from_sheet)


def test_the_sheet_is_as_exact_as_on_a_bare_wall(mi, tmp_path: Path) -> None:
    folder_of(tmp_path)
    exact = ("render: {band_samples: 256}", "render: {target_error: 0.01, background_error: 0.1}")
    frame = frame_of(own_study(tmp_path, "{pictures: walls}", LIGHT, exact), 2)
    radiance = render_radiance(mi, frame)
    found = measure_circle(frame, 0, radiance.mean, radiance.variance)
    assert "reason" not in found
    assert found["shift_se_px"] < 0.01
    assert abs(found["shift_x_px"]) < 4 * found["shift_se_px"]


def test_another_picture_is_another_study(tmp_path: Path) -> None:
    place = folder_of(tmp_path)
    first = own_study(tmp_path, "{pictures: walls}", LIGHT)
    (place / "0.png").write_bytes(png_bytes(np.zeros((40, 60, 3), dtype=np.uint8)))
    assert load_study(tmp_path / "study.yaml").digest() != first.digest()
    recorded = first.groups["main"].world.pictures_sha256
    text = (
        (tmp_path / "study.yaml")
        .read_text()
        .replace("{pictures: walls", f"{{pictures: walls, pictures_sha256: {recorded}")
    )
    (tmp_path / "study.yaml").write_text(text)
    with pytest.raises(StudyError, match=r"world.pictures: walls: are not the recorded pictures"):
        load_study(tmp_path / "study.yaml")
