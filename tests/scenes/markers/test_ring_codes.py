import numpy as np
import pytest
from helpers_markers import sheet

from roundel.scenes.markers.ink_pattern import reflectance_at
from roundel.scenes.markers.ring_codes import (
    CELLS,
    LEAST_DISTANCE,
    LEAST_WIDTH,
    ring_code_radii,
    ring_code_widths,
    ring_code_words,
)


def test_the_bank_keeps_its_distance() -> None:
    words = ring_code_words()
    assert words.shape == (41, CELLS)
    distance = np.count_nonzero(words[:, None] != words[None], axis=2) + CELLS * np.eye(len(words), dtype=int)
    assert distance.min() == LEAST_DISTANCE
    assert min(map(min, ring_code_widths())) == LEAST_WIDTH
    assert {sum(widths) for widths in ring_code_widths()} == {CELLS}


@pytest.mark.parametrize("identity", range(41))
def test_the_printed_profile_is_the_word(identity: int) -> None:
    made = sheet("ring_code", id=identity)
    (part,) = made.parts
    assert (part.kind, part.radius_m, part.inked) == ("ring_code", 0.04, True)
    assert part.layout == {"id": identity, "radii": list(ring_code_radii(identity))}
    middles = 0.04 * (CELLS - np.arange(CELLS) - 0.5) / CELLS
    ink = reflectance_at(made, 0.6 * middles, -0.8 * middles) < 0.4
    np.testing.assert_array_equal(ink, ring_code_words()[identity])
    assert reflectance_at(made, 0.0401, 0.0) == pytest.approx(0.8)


@pytest.mark.parametrize("identity", [-1, 41])
def test_an_identity_outside_the_bank_is_refused(identity: int) -> None:
    with pytest.raises(ValueError, match=f"id {identity} is not in the bank of ring codes; use 0 to 40"):
        ring_code_radii(identity)
