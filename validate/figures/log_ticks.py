"""Logarithmic axes with a few plain numbers as ticks, whose labels do not overlap."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axis import Axis


def set_log_ticks(axis: Axis, low: float, high: float, most: int = 4) -> None:
    """Label about `most` numbers between `low` and `high` on an axis that is already logarithmic.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
    low, high : float
        The displayed range, both positive.
    most : int
        Labels that fit side by side; 4 in a panel of 2 inches.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    decades = math.log10(high / low)
    fit = (subs for subs in ((1.0, 2.0, 5.0), (1.0, 3.0)) if len(subs) * decades <= most)
    axis.set_major_locator(LogLocator(subs=next(fit, (1.0,)), numticks=most + 1))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
