"""`roundel validate` of a CSV in another convention: status 0, the warning first, and the report leads with it."""

import json

import pytest
from helpers_conventions import STUDY, WRONG, write
from helpers_reports import estimate_rows, make_dataset

from roundel.cli.main import main
from roundel.validate.diagnosis.diagnosis import diagnose


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return make_dataset(tmp_path_factory.mktemp("cli") / "ds", STUDY.replace("frames: 60", "frames: 20"))


# Those whose rows are refused where no convention explains them, and one that is scored.
@pytest.mark.parametrize("name", ["opengl_axes", "flipped_normals", "millimetres", "frame_numbers", "half_pixel"])
def test_the_warning_comes_first_and_the_status_is_0(dataset, tmp_path, capfd, name):
    change, _ = WRONG[name]
    rows = [{**r, **change(r, "pose")} for r in estimate_rows(dataset, ["true"], 0.02) if r["candidate"] == 0]
    file, out = write(tmp_path / "mine.csv", rows, "pose"), tmp_path / "report"
    assert main(["validate", str(dataset.path), str(file), "--out", str(out)]) == 0
    captured = capfd.readouterr()
    (warning,) = [line for line in captured.err.splitlines() if "warning" in line]
    assert warning.startswith("roundel: warning: mine.csv: it seems that the file ")
    (found,) = json.loads((out / "summary.json").read_text())["diagnoses"]
    assert (found["convention"], found["part"]) == (name, "pose")
    assert found["fit_after"] >= 19
    page = (out / "report.html").read_text()
    assert page.index("Another convention?") < page.index('class="cards"')
    assert found["remedy"] in page


def test_a_right_file_beside_it_is_read_strictly(dataset, tmp_path, capfd):
    rows = [row for row in estimate_rows(dataset, ["true"], 0.02) if row["candidate"] == 0]
    wrong = write(tmp_path / "wrong.csv", [{**r, **WRONG["opengl_axes"][0](r, "pose")} for r in rows], "pose")
    broken = write(tmp_path / "broken.csv", [{**rows[0], "centre_z_m": -1.0}, *rows[1:]], "pose")
    assert diagnose(broken, dataset) == []
    assert main(["validate", str(dataset.path), str(wrong), str(broken), "--out", str(tmp_path / "report")]) == 2
    assert "broken.csv: frame 0" in capfd.readouterr().err
