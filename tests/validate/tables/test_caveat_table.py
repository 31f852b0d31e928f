"""The report's count of caveats."""

from __future__ import annotations

from types import SimpleNamespace

from roundel.validate.tables.report import NAMES, caveat_table


def test_intrinsics_with_the_same_count_share_a_row():
    records = [
        {"method": "pixels", "intrinsics": label, "caveat": "clipped pixels along the edge", "count": n, "of": 48}
        for label, n in (("true", 12), ("default", 12), ("exif", 11))
    ]
    table = caveat_table(SimpleNamespace(caveats=records))
    assert table.rows == (
        ("pixels", "true, default", "clipped pixels along the edge", 12, 48),
        ("pixels", "exif", "clipped pixels along the edge", 11, 48),
    )
    assert table.name in NAMES
    assert not caveat_table(SimpleNamespace(caveats=[])).rows
