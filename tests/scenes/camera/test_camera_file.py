"""Camera files as JSON and as YAML."""

from pathlib import Path

import pytest

from roundel.scenes.camera.camera_file import camera_file_text, read_camera_record
from roundel.scenes.errors import DataError, UsageError

RECORD = {"width_px": 640, "K": [[1.5e-7, 0.0, 319.5]], "calibration": {"sigma": {"fx": 1e-5}, "group": None}}


@pytest.mark.parametrize("name", ["camera.json", "camera.yaml", "camera.YML"])
def test_back_to_the_last_digit(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.write_text(camera_file_text(RECORD, file), encoding="utf-8")
    assert read_camera_record(file) == RECORD
    assert file.read_text(encoding="utf-8").startswith("{") == name.endswith("json")


def test_json_under_a_name_of_yaml(tmp_path: Path) -> None:
    file = tmp_path / "camera.yaml"
    file.write_text(camera_file_text(RECORD, "camera.json"), encoding="utf-8")
    assert read_camera_record(file) == RECORD


@pytest.mark.parametrize(
    ("name", "text"), [("a.yaml", "K: [1, 2"), ("a.yaml", "- 1\n- 2\n"), ("a.json", "{"), ("a.json", "[" * 100_000)]
)
def test_other_files_are_refused_on_one_line(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match="not a camera file") as caught:
        read_camera_record(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="`roundel calibrate` writes one"):
        read_camera_record(tmp_path / "none.yaml")
