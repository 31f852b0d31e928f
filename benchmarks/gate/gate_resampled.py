"""Error rates of the gate on resampled scores: losses in one group, and one pose a circle.

    python benchmarks/gate/gate_resampled.py [--baseline FILE] [--comparisons 1000] [--losses 300] [--out FILE]

Each side of a comparison draws, for each circle, the errors of a random circle of its group in a baseline, in units of
the bounds: fresh noise with the distribution that the solver has on rendered frames, and no image rendered. Losses are
made in these errors. What a loss in the images does is measured by gate.py. Resampled, too, are one pose a circle: the
errors are the same, and some poses lie beside the second solution, on frames that both sides share but for a part that
noise decides.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from gate_tables import HEAD, row, worse
from numpy.typing import NDArray

from roundel.validate.gate.baseline import BOUNDS, Baseline, read_baseline
from roundel.validate.gate.gate import GateResult
from roundel.validate.gate.quantities import CHI2, CONFIDENCE, POSE, QUANTITIES, SCORE, SHIFTS, floats, groups_of
from roundel.validate.metrics.uncertainty import DEGREES_OF_FREEDOM

Array = NDArray[np.float64]

# Larger groups are divided into parts of about this size, as a benchmark of many groups has.
PER_GROUP = 250
SHARES = (0.0, 0.3, 0.5, 0.6)
UNDECIDED = 0.2
AWAY_DEG = 40.0  # any angle between the two solutions: poses beside the second are not compared
_KEPT = (*(q.column for q in (*QUANTITIES, *SHIFTS)), SCORE, CHI2)


class Resampled:
    """Scores of one run of a baseline, drawn again circle by circle within its groups."""

    def __init__(self, baseline: Baseline, times: int = 1) -> None:
        rows, self.times = baseline.rows, times
        mine = rows.filter(_of_first_run(rows, rows))
        self.rows = pa.concat_tables([_renumbered(mine, i) for i in range(times)]).combine_chunks()
        self.n = self.rows.num_rows
        self.group = names = _divided(groups_of(self.rows))
        self.names = np.unique(names).tolist()
        self.members = [np.flatnonzero(names == name) for name in self.names]
        self.values = {name: floats(self.rows, name) for name in (*_KEPT, *BOUNDS)}
        self.baseline = baseline
        # Confidences of the false positives of each frame; of one circle a frame they are drawn with it.
        self.false: dict[int, list[float | None]] = {}
        if baseline.false_positives is not None:
            every = baseline.false_positives.filter(_of_first_run(baseline.false_positives, rows))
            for frame, confidence in zip(*(every[name].to_pylist() for name in ("frame_id", CONFIDENCE)), strict=True):
                self.false.setdefault(frame, []).append(confidence)

    def side(
        self,
        generator: np.random.Generator,
        scale: Array | float = 1.0,
        normal_scale: float = 1.0,
        wrong: NDArray[np.bool_] | None = None,
    ) -> Baseline:
        """One side of a comparison; its covariances follow a loss, so that accuracy alone tells it."""
        donor = np.empty(self.n, dtype=np.int64)
        for members in self.members:
            donor[members] = generator.choice(members, len(members))
        v, factor = self.values, np.broadcast_to(scale, self.n)
        data = {POSE.column: v[POSE.column][donor] * factor}
        for q in (*QUANTITIES[1:], *SHIFTS):
            bound = v[q.bound or QUANTITIES[-1].bound or ""]
            data[q.column] = (v[q.column] / bound)[donor] * bound * factor
        data["oracle_normal_error_deg"] = data["oracle_normal_error_deg"] * normal_scale
        data[CHI2] = v[CHI2][donor]
        # The size of the region is the circle's own; of one that the baseline did not solve, its donor's.
        size = v[SCORE] - 0.5 * v[CHI2]
        size = np.where(np.isfinite(size), size, size[donor])
        data[SCORE] = 0.5 * data[CHI2] + size + DEGREES_OF_FREEDOM * np.log(factor)
        if wrong is not None:
            data["oracle_normal_error_deg"] = np.where(wrong, AWAY_DEG, data["oracle_normal_error_deg"])
            data[POSE.column] = np.where(wrong, AWAY_DEG / v["normal_bound_deg"], data[POSE.column])
        rows = self.rows.select(["frame_id", "marker_id", "method", "intrinsics", *BOUNDS])
        rows = rows.append_column("group", pa.array(self.group.tolist()))
        for name, values in data.items():
            rows = rows.append_column(name, pa.array(values, mask=~np.isfinite(values), type=pa.float32()))
        for name in ("solved", "detected", CONFIDENCE):
            if name in self.rows.column_names:
                rows = rows.append_column(name, self.rows[name].take(pa.array(donor)))
        none = pa.nulls(self.n, pa.bool_())
        rows = rows.append_column("branch_correct", none if wrong is None else pa.array(~wrong))
        rows = rows.append_column("oracle_branch_correct", none if wrong is None else pa.array(~wrong))
        return replace(
            self.baseline, rows=rows, images=str(generator.integers(2**62)), false_positives=self._false(donor)
        )

    def _false(self, donor: NDArray[np.int64]) -> pa.Table | None:
        """The false positives of each circle's donor, on the circle's own frame."""
        known = self.baseline.false_positives
        if known is None:
            return None
        frames = self.rows["frame_id"].to_pylist()
        first = frames[: len(frames) // self.times]
        drawn = [
            {"frame_id": frame, CONFIDENCE: confidence}
            for frame, j in zip(frames, donor.tolist(), strict=True)
            for confidence in self.false.get(first[j % len(first)], [])
        ]
        run = {name: self.rows[name][0].as_py() for name in ("method", "intrinsics")}
        return pa.Table.from_pylist([{**run, **row} for row in drawn], schema=known.schema)


def _divided(names: NDArray[np.str_]) -> NDArray[np.str_]:
    """The group of each circle, or the part of a large one."""
    out = names.astype(object)
    for name in np.unique(names).tolist():
        members = np.flatnonzero(names == name)
        parts = max(1, round(len(members) / PER_GROUP))
        if parts > 1:
            out[members] = [f"{name} {1 + i * parts // len(members)}" for i in range(len(members))]
    return out.astype(np.str_)


def _of_first_run(table: pa.Table, rows: pa.Table) -> pa.ChunkedArray:
    """Which rows of a table are of the first run of a baseline."""
    return pc.and_(*(pc.equal(table[name], rows[name][0]) for name in ("method", "intrinsics")))


def _renumbered(rows: pa.Table, copy: int) -> pa.Table:
    """The same circles on other frames."""
    frames = rows["frame_id"].to_numpy()
    return rows.set_column(
        rows.column_names.index("frame_id"), "frame_id", pa.array(frames + copy * (frames.max() + 1))
    )


def pairs(
    count: int, new: Callable[..., Baseline], old: Callable[..., Baseline]
) -> Iterator[tuple[Baseline, Baseline]]:
    """Comparisons with a seed each; `new` and `old` are called with a generator and the comparison's number."""
    for i in range(count):
        yield new(np.random.default_rng([0, i]), i), old(np.random.default_rng([1, i]), i)


def whole_and_groups(source: Resampled, count: int) -> Iterator[str]:
    """Fresh noise, a loss in all circles, and a loss in one group alone."""

    def in_a_group(generator: np.random.Generator, i: int) -> Baseline:
        scale = np.ones(source.n)
        scale[source.members[i % len(source.members)]] = 1.2
        return source.side(generator, scale)

    def plain(generator: np.random.Generator, i: int) -> Baseline:
        return source.side(generator)

    sizes = sorted({len(members) for members in source.members})
    yield f"## {source.n} circles in {len(source.names)} groups of {' or '.join(map(str, sizes))}: resampled errors"
    yield from ["", *HEAD]
    yield row("fresh noise", pairs(count, plain, plain))
    yield row("all errors 5 % larger", pairs(count, lambda g, i: source.side(g, 1.05), plain))
    yield row("errors 20 % larger in one group, each in turn", pairs(count, in_a_group, plain))
    for k, name in enumerate(source.names):
        some = count // len(source.names)
        new = _fixed(source, source.members[k])
        yield row(f"20 % larger in {name}: the group is named", pairs(some, new, plain), _names_group(name))


def _fixed(source: Resampled, members: NDArray[np.int64]) -> Callable[..., Baseline]:
    scale = np.ones(source.n)
    scale[members] = 1.2
    return lambda generator, i: source.side(generator, scale)


def _names_group(name: str) -> Callable[[GateResult], bool]:
    return lambda result: any(check.endswith(f" in {name}") for check in worse(result))


def _named(name: str) -> Callable[[GateResult], bool]:
    return lambda result: name in worse(result)


def one_pose(source: Resampled, count: int, losses: int, undecided: float) -> Iterator[str]:
    """One pose a circle: fresh noise, the normal's noise doubled, and a branch that is wrong more often."""

    def side(share: float, normal_scale: float = 1.0) -> Callable[..., Baseline]:
        def made(generator: np.random.Generator, i: int) -> Baseline:
            by_frame = np.random.default_rng([2, i]).random(source.n)
            chance = np.where(generator.random(source.n) < undecided, generator.random(source.n), by_frame)
            return source.side(generator, normal_scale=normal_scale, wrong=chance < share)

        return made

    yield f"## One pose a circle, {source.n} circles: noise decides the branch in {100 * undecided:.0f} % of the frames"
    yield from ["", *HEAD]
    for share in SHARES:
        title = f"{100 * share:.0f} % wrong"
        yield row(f"{title}: fresh noise", pairs(count, side(share), side(share)))
        yield row(f"{title}: normal noise doubled", pairs(losses, side(share, 2.0), side(share)), _named("normal"))
        new = side(share + 0.05)
        yield row(f"{title}: wrong 5 points more often", pairs(losses, new, side(share)), _named("right candidate"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--baseline", default=str(Path(__file__).parents[1] / "baseline.parquet"))
    parser.add_argument("--comparisons", type=int, default=1000, help="number of comparisons of each kind")
    parser.add_argument("--losses", type=int, default=300, help="the same for losses of one pose a circle")
    parser.add_argument("--only", nargs="*", choices=("groups", "pose", "noise"), help="only these tables")
    parser.add_argument("--out", help="also write the tables to this file")
    options = parser.parse_args()
    baseline = read_baseline(options.baseline)
    source, count, losses = Resampled(baseline), options.comparisons, options.losses
    parts = {
        "groups": [whole_and_groups(source, count)],
        "pose": [one_pose(source, count, losses, UNDECIDED)],
        "noise": [one_pose(Resampled(baseline, times), losses, losses, 1.0) for times in (1, 2)],
    }
    lines: list[str] = []
    for part in chain.from_iterable(parts[name] for name in options.only or parts):
        for line in chain(part, [""]):
            print(line, flush=True)
            lines.append(line)
    if options.out:
        Path(options.out).write_text("# The gate on resampled scores\n\n" + "\n".join(lines).rstrip() + "\n", "utf-8")


if __name__ == "__main__":
    main()
