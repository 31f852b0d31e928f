"""The data card: its facts are those of the dataset, its page stands alone and cannot be injected into."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from helpers_reports import BOARDS, POINTS, make_dataset

from roundel.cli.main import main
from roundel.datasets.card.card import card_of, card_page
from roundel.datasets.card.contact_sheet import FRAMES, thumbnail
from roundel.datasets.card.distributions import distributions_of
from roundel.datasets.dataset import Dataset
from roundel.datasets.export.export import export_dataset
from roundel.datasets.stream.splits import Splits


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    text = BOARDS.replace("name: boards", "name: \"boards <script>alert('x')</script>\"")
    return make_dataset(tmp_path_factory.mktemp("card") / "ds", text)


def test_the_record_is_that_of_the_dataset(boards: Dataset) -> None:
    card = json.loads(json.dumps(card_of(boards), allow_nan=False))
    assert card["counts"]["frames"] == len(boards) == 9
    assert card["counts"]["kinds"] == {"chessboard": 9, "disc": 4}
    assert card["counts"]["groups"] == {"calibration": 5, "marker": 4}
    assert card["cameras"] == [{"width_px": 640, "height_px": 480, "distortion_model": "opencv", "frames": 9}]
    tilt = card["distributions"]["tilt_deg"]
    values = boards.truth["tilt_deg"].to_numpy()
    assert (tilt["n"], tilt["low"], tilt["high"]) == (len(values), values.min(), values.max())
    assert tilt["mean"] == pytest.approx(values.mean())
    assert sum(tilt["counts"]) == len(values)
    assert tilt["counts"] == np.histogram(values, bins=len(tilt["counts"]))[0].tolist()
    # Boards have no ellipse.
    assert card["distributions"]["ellipse_a_px"]["n"] == 4
    assert card["study"] == boards.study


def test_values_that_are_alike_are_one_bin(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "ds", POINTS.replace("tilt_deg: {grid: [15, 30, 45]}", "tilt_deg: 30"))
    found = distributions_of(dataset)
    assert found["tilt_deg"]["counts"] == [len(dataset)]
    assert len(found["distance_D"]["counts"]) > 1
    page = card_page(card_of(dataset), dataset).decode()
    assert "The same for all: " in page
    assert "tilt [deg] 30" in page
    # Frames of points have no pictures.
    assert "<img" not in page


def test_the_page_stands_alone(boards: Dataset) -> None:
    page = card_page(card_of(boards), boards).decode()
    assert page == card_page(card_of(boards), boards).decode()
    assert "<script" not in page
    assert "boards &lt;script&gt;" in page
    # Nothing is loaded: addresses are those of a link, and of pictures in the page.
    assert {url.split(":")[0] for url in re.findall(r'src="([^"]*)"', page)} == {"data"}
    assert page.count("<img") == min(FRAMES, len(boards))
    assert str(boards.path) not in page


def test_thumbnails_of_deep_images() -> None:
    from io import BytesIO

    from PIL import Image

    deep = (np.arange(64 * 64).reshape(64, 64) % 4096).astype(np.uint16) << 4
    small = np.asarray(Image.open(BytesIO(thumbnail(deep, 16))))
    assert small.shape == (64, 64)
    assert abs(int(small[-1, -1]) - 255) < 12
    assert small[0, 0] < 12


def test_the_command_and_exports_write_it(boards: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["card", str(boards.path), str(tmp_path / "card")]) == 0
    assert "9 frames" in capsys.readouterr().out
    assert (tmp_path / "card" / "card.json").read_bytes()
    assert main(["card", str(boards.path), str(boards.path)]) == 2
    assert main(["card", str(tmp_path), str(tmp_path / "out")]) == 4
    (tmp_path / "file").write_text("")
    assert main(["card", str(boards.path), str(tmp_path / "file")]) == 2
    assert capsys.readouterr().err.count("\n") == 3
    export_dataset(boards, tmp_path / "coco", "coco", Splits((0.5, 0.25, 0.25)))
    card = json.loads((tmp_path / "coco" / "card.json").read_text())
    assert sum(card["counts"]["splits"].values()) == len(boards)
    assert b"<h1>" in (tmp_path / "coco" / "card.html").read_bytes()
