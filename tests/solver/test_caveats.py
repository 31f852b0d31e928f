"""Sentences and counts of caveats."""

from __future__ import annotations

import pytest

from roundel.solver import caveats

EVERY = (
    caveats.clipped_words(0.083),
    caveats.rejected_words(0.2),
    caveats.misfit_words(10.24),
    caveats.fallback_words("too few pixels along the contour"),
    caveats.curve_words("srgb"),
    caveats.CURVE_UNKNOWN,
    caveats.BORDER,
    caveats.SHARPENED_RECORD,
    caveats.SHARPENED_PIXELS,
    caveats.TONED,
)


def test_sentences():
    assert EVERY[0] == "8 % of the edge's pixels are clipped"
    assert "3.2 times their noise" in EVERY[2]
    assert EVERY[4] == "the response curve was estimated: sRGB"
    assert caveats.clipped_words(0.0) == caveats.rejected_words(0.01) == ""
    assert caveats.clipped_words(0.006).startswith("0.6 %")
    # A table joins them by semicolons.
    assert not any(";" in sentence for sentence in EVERY)


@pytest.mark.parametrize("sentence", EVERY)
def test_every_sentence_has_a_kind(sentence):
    assert caveats.heading_of(sentence) != caveats.OTHER


def test_counts_are_of_estimates_and_ordered():
    found = caveats.count_caveats([(EVERY[0], EVERY[6]), (EVERY[0],), (), ("my own words",), EVERY[7:9]])
    assert found == {
        "clipped pixels along the edge": 2,
        "cut by the image's border": 1,
        "sharpened image": 1,
        "other": 1,
    }
    assert next(iter(found)) == "clipped pixels along the edge"
