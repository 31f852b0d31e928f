"""Labels of intrinsics: parsing, order, and one text for each context."""

import pytest

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel


@pytest.mark.parametrize(
    ("label", "views", "right", "short", "title"),
    [
        ("true", None, True, "true", "true"),
        ("calibrated:5", 5, True, "calibrated:5", "calibrated, 5 views"),
        ("calibrated:phone.json", None, True, "calibrated:phone.json", "calibrated"),
        ("exif", None, False, "exif", "EXIF"),
        ("default:width", None, False, "default:width", "default:width"),
        ("default:2020s", None, False, "default:2020s", "default:2020s"),
        ("scaled:0.7", None, False, "x0.7", "focal x 0.7"),
        ("scaled:1", None, True, "x1", "focal x 1"),
        ("mine", None, False, "mine", "mine"),
        ("calibrated:\u0665", None, True, "calibrated:\u0665", "calibrated"),
    ],
)
def test_what_a_label_means(label: str, views: int | None, right: bool, short: str, title: str) -> None:
    found = IntrinsicsLabel.of(label)
    assert (found.text, found.views, found.is_right, found.short, found.title) == (label, views, right, short, title)
    assert found.phrase


def test_the_best_known_comes_first() -> None:
    labels = ["mine", "scaled:1.3", "default", "calibrated:5", "calibrated:40", "exif", "true", "scaled:0.7"]
    assert sorted(labels, key=lambda label: IntrinsicsLabel.of(label).rank) == [
        "true", "calibrated:40", "calibrated:5", "exif", "default", "scaled:0.7", "scaled:1.3", "mine",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("label", "phrase"),
    [
        ("default", "the default focal length of a phone"),
        ("default:width", "the default focal length of a phone (taken by width)"),
        ("default:2020s", "the default focal length of a phone of the 2020s"),
        ("default:2020s:width", "the default focal length of a phone of the 2020s (taken by width)"),
    ],
)
def test_the_default_in_a_sentence(label: str, phrase: str) -> None:
    assert IntrinsicsLabel.of(label).phrase == phrase
