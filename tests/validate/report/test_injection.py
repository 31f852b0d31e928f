"""User text is inert in a report: study, group, method, intrinsics, reason, and file names."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
from helpers_reports import POINTS, estimate_rows, failed_row, make_dataset, write_estimates

from roundel.validate.report.compare import compare_reports
from roundel.validate.validate import validate_dataset

EVIL = (
    "</style><script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "</svg></title><iframe src=//x>",
    "\u202egnp.exe\u2066",
    "$\\frac$ {{ 7*7 }} {% raw %}",
)
ACTIVE = {"script", "iframe", "img", "object", "embed", "link", "base", "form", "a:external"}


class Page(HTMLParser):
    """What a page would do: active tags, handlers, links that leave it."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.found: set[str] = set()
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in ACTIVE:
            self.found.add(tag)
        for key, value in attrs:
            if key.startswith("on"):
                self.found.add(key)
            if key in ("href", "src") and not (value or "").startswith(("#", "data:image/png;base64,")):
                self.found.add(f"{key}={value}")


def check(html: str) -> None:
    assert Page(html).found == set()
    # One style sheet in the head, which nothing closes early.
    svgs = html.count('<svg class="figure"')
    assert html.count("</style>") == html.count("<style") == 1 + html.count('<style type="text/css">') == 1 + svgs
    assert not re.search("[\u202a-\u202e\u2066-\u2069\x00-\x08\x0b-\x1f]", html.replace("\r", ""))


@pytest.fixture(scope="module", params=[0, 2])
def evil(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report with another hostile text in each place that takes one."""
    study_name, method, other, label, reason = (EVIL[(request.param + i) % len(EVIL)] for i in range(5))
    folder = tmp_path_factory.mktemp("evil")
    text = POINTS.replace("name: points", f"name: {json.dumps(study_name)}")
    dataset = make_dataset(folder / "ds", text.replace("frames_per_cell: 4", "frames_per_cell: 3"))
    label = f"calibrated:{label}"
    rows = [r for r in estimate_rows(dataset, [label, "true"], 0.1, method) if r["frame_id"] != 5]
    rows += [failed_row(5, name, reason=reason, method=method) for name in (label, "true")]
    rows += estimate_rows(dataset, ["true"], 0.2, "_" + other)
    write_estimates(folder / "e.parquet", rows)
    out = folder / re.sub("[/\x00]", "_", other)
    validate_dataset(dataset.path, [folder / "e.parquet"], out)
    return out


def test_a_report_of_hostile_names(evil: Path) -> None:
    check((evil / "report.html").read_text())


def test_a_comparison_of_hostile_names(evil: Path, tmp_path: Path) -> None:
    shutil.copytree(evil, tmp_path / "other")
    compare_reports([evil, tmp_path / "other"], tmp_path / "out")
    check((tmp_path / "out" / "compare.html").read_text())


def test_tables_of_hostile_names(evil: Path) -> None:
    for file in (evil / "tables").iterdir():
        text = file.read_text()
        assert not re.search("[\u202a-\u202e\u2066-\u2069]", text)
        if file.suffix == ".md":
            assert "<" not in text


def test_figures_of_hostile_names(evil: Path) -> None:
    files = list((evil / "figures").iterdir())
    assert files
    assert [file.name for file in files if not re.fullmatch(r"[a-z0-9_][a-z0-9._-]*\.svg", file.name)] == []
    for file in files:
        tags = {element.tag.partition("}")[2] for element in ElementTree.parse(file).iter()}
        assert tags.isdisjoint({"script", "foreignObject", "image", "a", "iframe"})


def test_a_name_without_end_is_cut(tmp_path: Path) -> None:
    name = "n" * 10_000
    # A study's own name is held to 200.
    dataset = make_dataset(tmp_path / "ds", POINTS.replace("name: points", f"name: {name[:200]}"))
    rows = estimate_rows(dataset, ["true"], 0.1, name)
    summary = validate_dataset(dataset.path, [write_estimates(tmp_path / "e.parquet", rows)], tmp_path / "out")
    assert summary.runs[0]["method"] == name  # files keep it
    html = (tmp_path / "out" / "report.html").read_text()
    assert ("n" * 100 in html) is False  # no diff of 10,000 letters
    assert len(html) < 1_000_000
