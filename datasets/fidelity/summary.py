"""Fidelity of a dataset, summarised over circles and by effect."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from roundel.datasets.fidelity.pixel_test import LEVEL

_SHIFTS = ("shift_x_px", "shift_y_px", "scale_px")


def summarise(measured: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The fidelity of a dataset, as stored in its manifest.

    Parameters
    ----------
    measured : sequence of dict
        Results of `measure_circle`, one per circle.

    Returns
    -------
    dict
        `circles`, the number measured (the same rays under several sensors count once). For each of `shift_x_px`,
        `shift_y_px` and `scale_px` the `mean`, half the width of its 95 % interval `ci95`, and the `worst`
        absolute value; `shift_bound_px`, the 95 % bound of the mean shifts; `residual`, `monte_carlo` and `z_rms`
        as RMS over the circles; `z_passed`, the number that passed the pixel test, and `z_consistent`, whether no
        more failed than expected by chance. `by_effect`: the same for each effect. `unmeasured`: the number of
        circles left out, by reason.
    """
    # Levels of a sweep that differ only in the sensor share their rays: one measurement, not several.
    found = list({tuple(sorted(m.items())): m for m in measured if "reason" not in m}.values())
    reasons = Counter(m["reason"] for m in measured if "reason" in m)
    left_out = {"unmeasured": dict(sorted(reasons.items()))} if reasons else {}
    if not found:
        reason = reasons.most_common(1)[0][0] if reasons else "no circle was rendered"
        return {"circles": 0, "reason": reason, **left_out}
    effects = sorted({m["effect"] for m in found})
    by_effect = {effect: _figures([m for m in found if m["effect"] == effect]) for effect in effects}
    return {**_figures(found), "by_effect": by_effect, **left_out}


def _figures(found: list[dict[str, Any]]) -> dict[str, Any]:
    from scipy.stats import t as student

    count = len(found)
    out: dict[str, Any] = {"circles": count}
    for key in _SHIFTS:
        values = np.array([m[key] for m in found])
        # One circle has no scatter; its own standard error is used instead.
        if count > 1:
            half = float(student.ppf(0.975, count - 1) * values.std(ddof=1) / np.sqrt(count))
        else:
            half = 1.96 * found[0]["shift_se_px"]
        out[key] = {"mean": float(values.mean()), "ci95": half, "worst": float(np.abs(values).max())}
    out["shift_bound_px"] = max(abs(out[key]["mean"]) + out[key]["ci95"] for key in _SHIFTS[:2])
    for key in ("residual", "monte_carlo", "z_rms"):
        out[key] = float(np.sqrt(np.mean([m[key] ** 2 for m in found])))
    passed = sum(bool(m["z_passed"]) for m in found)
    out["z_passed"] = passed
    out["z_consistent"] = _consistent(passed, count)
    return out


def join_summaries(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The fidelity of several shards together, from their summaries.

    Means, scatter and RMS are those over all circles; rays that several sensors share count once in each shard.
    """
    found = [part for part in parts if part.get("circles")]
    reasons: Counter[str] = Counter()
    for part in parts:
        reasons.update(part.get("unmeasured", {}))
    left_out = {"unmeasured": dict(sorted(reasons.items()))} if reasons else {}
    if not found:
        return {"circles": 0, "reason": parts[0]["reason"] if parts else "no circle was rendered", **left_out}
    effects = sorted({effect for part in found for effect in part["by_effect"]})
    by_effect = {
        effect: _joined([part["by_effect"][effect] for part in found if effect in part["by_effect"]])
        for effect in effects
    }
    return {**_joined(found), "by_effect": by_effect, **left_out}


def _joined(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    from scipy.stats import t as student

    counts = np.array([part["circles"] for part in parts], dtype=np.float64)
    count = int(counts.sum())
    out: dict[str, Any] = {"circles": count}
    for key in _SHIFTS:
        means = np.array([part[key]["mean"] for part in parts])
        mean = float(np.sum(counts * means) / count)
        # Sum of squares about the common mean: that about each shard's own, from its interval, and between them.
        half = np.array([part[key]["ci95"] for part in parts])
        width = np.where(counts > 1, student.ppf(0.975, np.maximum(counts - 1, 1)), np.inf)
        squares = float(np.sum((counts - 1) * counts * (half / width) ** 2 + counts * (means - mean) ** 2))
        error = np.sqrt(squares / (count - 1) / count) if count > 1 else 0.0
        interval = float(student.ppf(0.975, count - 1) * error) if count > 1 else float(half[0])
        out[key] = {"mean": mean, "ci95": interval, "worst": max(part[key]["worst"] for part in parts)}
    out["shift_bound_px"] = max(abs(out[key]["mean"]) + out[key]["ci95"] for key in _SHIFTS[:2])
    for key in ("residual", "monte_carlo", "z_rms"):
        out[key] = float(np.sqrt(np.sum(counts * [part[key] ** 2 for part in parts]) / count))
    out["z_passed"] = sum(part["z_passed"] for part in parts)
    out["z_consistent"] = _consistent(out["z_passed"], count)
    return out


def _consistent(passed: int, count: int) -> bool:
    from scipy.stats import binom

    return bool(count - passed <= binom.ppf(1 - LEVEL, count, LEVEL))


def fidelity_lines(fidelity: dict[str, Any] | None) -> list[str]:
    """Summary text of a manifest's fidelity, as lines."""
    measured = fidelity or {}
    if not measured.get("circles"):
        return [f"fidelity: not measured ({measured.get('reason', 'no circles')})"]
    x, y, scale = (measured[key] for key in _SHIFTS)
    lines = [
        f"fidelity over {_circles(measured)}, image against float64 prediction: "
        f"shift x {_interval(x)}, y {_interval(y)}, size {_interval(scale)}; "
        f"edge residual {100 * measured['residual']:.2f} % of the contrast "
        f"(Monte-Carlo error {100 * measured['monte_carlo']:.2f} %); {_test(measured)}"
    ]
    by_effect = measured.get("by_effect", {})
    if set(by_effect) - {"sharp"}:
        lines += [
            f"  {effect.replace('_', ' ')}: {_circles(figures)}, shift within {figures['shift_bound_px']:.4f} px at "
            f"95 %, {_test(figures)}"
            for effect, figures in by_effect.items()
        ]
    if "unmeasured" in measured:
        lines.append("  not measured: " + ", ".join(f"{n} ({why})" for why, n in measured["unmeasured"].items()))
    return lines


def _circles(figures: dict[str, Any]) -> str:
    return f"{figures['circles']} circle{'s' if figures['circles'] != 1 else ''}"


def _interval(figure: dict[str, float]) -> str:
    return f"{figure['mean']:+.5f} +- {figure['ci95']:.5f} px"


def _test(figures: dict[str, Any]) -> str:
    if "z_passed" not in figures:
        return "pixels not tested"
    verdict = "" if figures["z_consistent"] else ": more failures than expected by chance"
    return f"pixel test passed by {figures['z_passed']} of {figures['circles']}{verdict}"
