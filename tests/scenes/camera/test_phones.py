"""The table of phone cameras, the normal distributions fitted to it, and the constants taken from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from roundel.scenes.camera.film import FOCAL_35MM_2020S_MM, FOCAL_35MM_2020S_SIGMA_MM
from roundel.scenes.camera.phones import (
    EPOCHS,
    ROLES,
    PhoneCamera,
    faults,
    fit_normal,
    focal_lengths_mm,
    read_phones,
)
from roundel.scenes.errors import DataError

HEAD = ",".join(PhoneCamera.__dataclass_fields__)


@pytest.fixture(scope="module")
def phones() -> tuple[PhoneCamera, ...]:
    return read_phones()


def test_every_row_has_source_year_role_and_a_plausible_value(phones) -> None:
    assert faults(phones) == []


def test_there_are_thirty_main_cameras_or_more_and_some_of_each_other_role(phones) -> None:
    counts = {role: len(focal_lengths_mm(phones, role)) for role in ROLES}
    assert counts["main"] >= 30
    assert min(counts.values()) >= 10


def test_every_epoch_has_enough_for_a_standard_deviation_within_a_fifth(phones) -> None:
    for epoch in EPOCHS:
        fit = fit_normal(focal_lengths_mm(phones, epoch=epoch))
        assert fit.sigma_error < 0.2 * fit.sigma
    assert sum(len(focal_lengths_mm(phones, epoch=epoch)) for epoch in EPOCHS) == len(focal_lengths_mm(phones))


def test_the_prior_of_the_2020s_is_the_fit_to_the_table(phones) -> None:
    fit = fit_normal(focal_lengths_mm(phones, epoch=EPOCHS[-1]))
    assert (round(fit.mean, 2), round(fit.sigma, 2)) == (FOCAL_35MM_2020S_MM, FOCAL_35MM_2020S_SIGMA_MM)


def test_the_table_is_in_order(phones) -> None:
    keys = [(p.year, p.maker.lower(), p.model.lower(), ROLES.index(p.role), p.focal_35mm_mm) for p in phones]
    assert keys == sorted(keys)


def test_a_fit_agrees_with_scipy_and_its_errors_with_repetition() -> None:
    rng = np.random.default_rng(5)
    samples = rng.normal(25.0, 2.0, (4000, 20))
    fits = [fit_normal(sample) for sample in samples]
    mean, sigma = stats.norm.fit(samples[0])
    assert fits[0].mean == pytest.approx(mean, rel=1e-12)
    assert fits[0].sigma == pytest.approx(sigma * np.sqrt(20 / 19), rel=1e-12)  # scipy's has n in the denominator
    # 4,000 repetitions know a standard deviation to 1.1 %; 5 % is more than four times that.
    assert np.std([fit.mean for fit in fits]) == pytest.approx(np.mean([f.mean_error for f in fits]), rel=0.05)
    assert np.std([fit.sigma for fit in fits]) == pytest.approx(np.mean([f.sigma_error for f in fits]), rel=0.05)


def test_one_value_has_no_standard_deviation() -> None:
    with pytest.raises(ValueError, match="two values"):
        fit_normal([26.0])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"source": " "}, "no source"),
        ({"year_source": ""}, "no year_source"),
        ({"checked": ""}, "no checked"),
        ({"role": "selfie"}, "the role must be"),
        ({"focal_35mm_mm": 52.0}, "outside 18 to 40 mm"),
        ({"role": "tele"}, "outside 45 to 250 mm"),
        ({"year": 1999}, "implausible year 1999"),
        ({"checked": "35 mm"}, "does not show 26"),
    ],
)
def test_a_fault_is_found(change, says) -> None:
    sound = PhoneCamera("Maker", "One", 2020, "main", 26.0, "", "page", "https://a.b", "same page", "26 mm")
    assert faults([sound]) == []
    assert any(says in fault for fault in faults([replace(sound, **change)]))


def test_a_phone_has_one_main_camera_and_may_have_two_long_ones() -> None:
    main = PhoneCamera("Maker", "One", 2020, "main", 26.0, "", "page", "https://a.b", "same page", "26, 70, 120 mm")
    long = replace(main, role="tele", focal_35mm_mm=70.0)
    assert faults([main, long, replace(long, focal_35mm_mm=120.0)]) == []
    assert faults([main, replace(main, model="ONE", focal_35mm_mm=26.0)]) == ["Maker ONE (main): in the table twice"]
    assert faults([long, long]) == ["Maker One (tele): in the table twice"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("maker,model\n", r"phones\.csv:1: the columns must be maker, model, year"),
        (f"{HEAD}\na,b,2020,main,twenty,,page,s,s,c\n", r"phones\.csv:2: could not convert"),
        (f"{HEAD}\na,b,MMXX,main,26,,page,s,s,c\n", r"phones\.csv:2: invalid literal"),
        (f"{HEAD}\na,b,2020,main,26\n", r"phones\.csv:2: 10 columns"),
        (f"{HEAD}\na,b,2020,main,26,,page,s,s,c,more\n", r"phones\.csv:2: 10 columns"),
    ],
)
def test_a_broken_table_is_one_line(text, says) -> None:
    with pytest.raises(DataError, match=says) as error:
        read_phones(text)
    assert "\n" not in str(error.value)
