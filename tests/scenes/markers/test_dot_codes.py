from itertools import product

import numpy as np
import pytest
from helpers_markers import sheet

from roundel.scenes.markers.dot_codes import (
    INNER,
    LEAST_DISTANCE,
    SECTORS,
    dot_code_words,
    dot_places,
    dots_of,
    inked_places,
)
from roundel.scenes.markers.ink_pattern import reflectance_at


def test_all_rotations_of_all_words_differ_in_five_sectors() -> None:
    words = np.array(dot_code_words())
    assert words.shape == (40, SECTORS)
    turned = np.concatenate([np.roll(words, k, axis=1) for k in range(SECTORS)])
    differ = np.count_nonzero(turned[:, None] != turned[None], axis=2) + SECTORS * np.eye(len(turned), dtype=int)
    assert differ.min() == LEAST_DISTANCE


def test_words_are_those_of_a_cyclic_code() -> None:
    # The check polynomial of a cyclic code: (x^11 - 1) / g has the other roots, and h(x) w(x) = 0 modulo x^11 - 1.
    dividend, generator = [-1, *[0] * 10, 1], [-1, 0, 1, -1, 1, 1]
    check = [0] * 7
    rest = list(dividend)
    for i in range(6, -1, -1):
        check[i] = rest[i + 5] % 3
        for j, g in enumerate(generator):
            rest[i + j] -= check[i] * g
    assert all(v % 3 == 0 for v in rest)
    for word in dot_code_words():
        product_ = np.convolve(word, check)
        folded = [sum(product_[i::11]) % 3 for i in range(11)]
        assert folded == [0] * 11


def test_every_sector_has_a_dot_and_the_dots_span_the_circle() -> None:
    for identity, word in enumerate(dot_code_words()):
        inked = inked_places(word)
        assert np.all(inked[:SECTORS] | inked[SECTORS:])
        assert sum(s == INNER for s in word) <= 3
        x, y, r = dots_of(identity).T
        np.testing.assert_allclose((np.hypot(x, y) + r).max(), 1.0, rtol=1e-15)


def test_places_are_apart() -> None:
    x, y, r = dot_places().T
    gaps = [np.hypot(x[i] - x[j], y[i] - y[j]) - r[i] - r[j] for i, j in product(range(22), repeat=2) if i < j]
    assert min(gaps) > 0.1


@pytest.mark.parametrize("identity", [0, 17, 39])
def test_the_printed_dots_are_those_of_the_word(identity: int) -> None:
    made = sheet("dot_code", id=identity)
    (part,) = made.parts
    assert (part.kind, part.radius_m, part.inked, part.layout) == ("dot_code", 0.04, False, {"id": identity})
    x, y, _ = 0.04 * dot_places().T
    np.testing.assert_array_equal(reflectance_at(made, x, y) < 0.4, inked_places(dot_code_words()[identity]))


@pytest.mark.parametrize("identity", [-1, 40])
def test_an_identity_outside_the_bank_is_refused(identity: int) -> None:
    with pytest.raises(ValueError, match=f"id {identity} is not in the bank of dot codes; use 0 to 39"):
        dots_of(identity)
