"""docs/phones.md agrees with the table of phones and with the constants it quotes."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from roundel.scenes.camera.film import DEFAULT_FOCAL_35MM_MM, FOCAL_35MM_2020S_MM, FOCAL_35MM_2020S_SIGMA_MM
from roundel.scenes.camera.phones import EPOCHS, fit_normal, focal_lengths_mm, read_phones

HOUSE = Path(__file__).resolve().parents[1]
PAGE = HOUSE / "docs" / "phones.md"


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(HOUSE / "docs" / "phones"))
    for name in ("make", "figures"):  # other pages have modules of the same names
        sys.modules.pop(name, None)
    import make

    yield make
    for name in ("make", "figures"):
        sys.modules.pop(name, None)


def test_its_tables_are_those_of_the_data_file(make) -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert make.filled(page, read_phones()) == page


def test_another_table_is_another_page(make) -> None:
    phones = read_phones()
    page = PAGE.read_text(encoding="utf-8")
    assert make.filled(page, phones[1:]) != page


def test_its_figures_are_those_of_the_data_file(make, monkeypatch, tmp_path) -> None:
    import figures

    monkeypatch.setattr(figures, "HERE", tmp_path)
    figures.main(read_phones())
    for name in ("fits.svg", "years.svg"):
        assert numbers_of(tmp_path / name) == pytest.approx(numbers_of(PAGE.parent / "phones" / name), abs=0.02)


def numbers_of(picture: Path) -> list[float]:
    """The coordinates of all paths; 0.02 pt is a rounding, and invisible."""
    paths = re.findall(r' d="([^"]*)"', picture.read_text(encoding="utf-8"))
    return [float(number) for path in paths for number in re.findall(r"-?\d+(?:\.\d+)?", path)]


@pytest.mark.parametrize("name", ["phones.md", "photographs.md", "method.md", "conventions.md"])
def test_every_page_quotes_the_prior_of_the_2020s(name: str) -> None:
    text = (HOUSE / "docs" / name).read_text(encoding="utf-8")
    assert f"{FOCAL_35MM_2020S_MM} mm" in text
    assert f"{100 * FOCAL_35MM_2020S_SIGMA_MM / FOCAL_35MM_2020S_MM:.1f} %" in text


def test_the_counts_in_the_text_are_those_of_the_table() -> None:
    phones = read_phones()
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    first, _, last = (fit_normal(focal_lengths_mm(phones, epoch=epoch)) for epoch in EPOCHS)
    assert f"of {first.n} phones up to 2014 the mean is {first.mean:.2f} mm" in text
    assert f"of {last.n} phones, one at 19 mm and one at 35 mm" in text
    within = [
        [abs(mm / DEFAULT_FOCAL_35MM_MM - 1) <= 0.3 for mm in focal_lengths_mm(phones, epoch=epoch)] for epoch in EPOCHS
    ]
    assert [epoch.count(False) for epoch in within] == [0, 0, 1]  # "one phone of 56, with 19 mm, is outside"
    assert f"has {len(phones)} cameras of {len({phone.name for phone in phones})} phones" in text
