"""Cameras of phones: a table with sources, and normal distributions fitted to it.

The table, `phones.csv`, is made by hand; each row says where its focal length was read and what a second reading found.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import resources

import numpy as np

from roundel.scenes.errors import DataError

TABLE = "phones.csv"
ROLES = ("main", "ultrawide", "tele")
# Focal lengths that a camera of each role may have, 35-mm equivalent in mm. The ranges do not meet on purpose: what
# falls between two of them is looked at again before it enters the table.
PLAUSIBLE_MM = {"main": (18.0, 40.0), "ultrawide": (10.0, 18.0), "tele": (45.0, 250.0)}


@dataclass(frozen=True)
class PhoneCamera:
    """One camera on the back of a phone.

    Attributes
    ----------
    maker, model : str
    year : int
        Of the announcement.
    role : str
        `main`, `ultrawide` or `tele`.
    focal_35mm_mm : float
        35-mm-equivalent focal length, as its source states it.
    aspect : str
        Of the photograph whose EXIF was read, such as `4:3`; empty for other sources.
    kind : str
        Of the source: `exif` (the tag of a photograph), `table` or `copy` (specifications in a public repository),
        `page` (a web page).
    source, year_source : str
        Where focal length and year were read.
    checked : str
        What the second reading of the source found.
    """

    maker: str
    model: str
    year: int
    role: str
    focal_35mm_mm: float
    aspect: str
    kind: str
    source: str
    year_source: str
    checked: str

    @property
    def name(self) -> str:
        """Maker and model."""
        return f"{self.maker} {self.model}"


@dataclass(frozen=True)
class Epoch:
    """Phones of some years, both included."""

    name: str
    first: int
    last: int


# The paper's phones are of the first: it was written with phones of up to about 2014.
EPOCHS = (Epoch("up to 2014", 2000, 2014), Epoch("2015 to 2019", 2015, 2019), Epoch("2020 and later", 2020, 2099))


@dataclass(frozen=True)
class NormalFit:
    """A normal distribution fitted to a sample, with standard errors.

    Attributes
    ----------
    n : int
        Size of the sample.
    mean, sigma : float
        Mean and standard deviation (n - 1 in the denominator), in the unit of the sample.
    mean_error, sigma_error : float
        Their standard errors, sigma / sqrt(n) and sigma / sqrt(2 (n - 1)); the second holds for normal samples.
    """

    n: int
    mean: float
    sigma: float
    mean_error: float
    sigma_error: float


def read_phones(text: str | None = None) -> tuple[PhoneCamera, ...]:
    """Read the table.

    Parameters
    ----------
    text : str, optional
        Contents of another table of the same columns; default: the table that is installed.

    Raises
    ------
    DataError
        If a column is missing, or a number is none. The message names the line.
    """
    if text is None:
        text = resources.files("roundel.scenes.camera").joinpath(TABLE).read_text(encoding="utf-8")
    reader = csv.DictReader(io.StringIO(text))
    wanted = list(PhoneCamera.__dataclass_fields__)
    if reader.fieldnames != wanted:
        raise DataError(f"{TABLE}:1: the columns must be {', '.join(wanted)}")
    phones = []
    for row in reader:
        if None in row or None in row.values():
            raise DataError(f"{TABLE}:{reader.line_num}: {len(wanted)} columns are needed")
        try:
            year, focal = int(row["year"]), float(row["focal_35mm_mm"])
        except ValueError as error:
            raise DataError(f"{TABLE}:{reader.line_num}: {error}") from error
        words = {name: row[name] for name in wanted if name not in ("year", "focal_35mm_mm")}
        phones.append(PhoneCamera(year=year, focal_35mm_mm=focal, **words))
    return tuple(phones)


def faults(phones: Iterable[PhoneCamera]) -> list[str]:
    """What is wrong with the rows of a table, a sentence each: no source, an implausible value, a phone twice."""
    found, seen = [], set()
    for phone in phones:
        where = f"{phone.name} ({phone.role})"
        low, high = PLAUSIBLE_MM.get(phone.role, (math.inf, -math.inf))
        for name in ("maker", "model", "kind", "source", "year_source", "checked"):
            if not getattr(phone, name).strip():
                found.append(f"{where}: no {name}")
        if phone.role not in ROLES:
            found.append(f"{where}: the role must be {', '.join(ROLES)}")
        elif not low <= phone.focal_35mm_mm <= high:
            found.append(f"{where}: {phone.focal_35mm_mm:g} mm is outside {low:g} to {high:g} mm")
        if not EPOCHS[0].first <= phone.year <= EPOCHS[-1].last:
            found.append(f"{where}: implausible year {phone.year}")
        if f"{phone.focal_35mm_mm:g}" not in phone.checked:
            found.append(f"{where}: the second reading does not show {phone.focal_35mm_mm:g}")
        # A phone has one main camera, but may have several telephoto cameras.
        key = (phone.name.lower(), phone.role, phone.focal_35mm_mm if phone.role == "tele" else 0.0)
        if key in seen:
            found.append(f"{where}: in the table twice")
        seen.add(key)
    return found


def focal_lengths_mm(phones: Iterable[PhoneCamera], role: str = "main", epoch: Epoch | None = None) -> list[float]:
    """35-mm-equivalent focal lengths of the cameras of a role, of all years or of an epoch, in the table's order."""
    return [
        phone.focal_35mm_mm
        for phone in phones
        if phone.role == role and (epoch is None or epoch.first <= phone.year <= epoch.last)
    ]


def fit_normal(sample: Iterable[float]) -> NormalFit:
    """Fit a normal distribution.

    Parameters
    ----------
    sample : iterable of float
        Two values or more.

    Raises
    ------
    ValueError
        If there are fewer.
    """
    values = np.fromiter(sample, dtype=np.float64)
    n = int(values.size)
    if n < 2:
        raise ValueError("a standard deviation needs two values or more")
    sigma = float(values.std(ddof=1))
    return NormalFit(n, float(values.mean()), sigma, sigma / math.sqrt(n), sigma / math.sqrt(2 * (n - 1)))
