"""Statements of a solver that are no longer true, and what `roundel gate` says: the same poses with other uncertainty.

    python benchmarks/gate/gate_statements.py RUN [--baseline FILE] [--out FILE]

RUN is the folder of `roundel run benchmark RUN`. Its estimates are written again with other covariances, probabilities
or confidences, and validated and gated as a user would.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from gate_bugs import failed, said

from roundel.solver.estimates import ESTIMATES

Change = Callable[[pa.Table], pa.Table]


def with_column(table: pa.Table, name: str, values: pa.ChunkedArray) -> pa.Table:
    """A table with other values in one column."""
    at = table.column_names.index(name)
    return table.set_column(at, table.schema.field(at), values)


def covariances(factor: float) -> Change:
    """All covariances times a factor."""

    def change(table: pa.Table) -> pa.Table:
        for name in table.column_names:
            if name.startswith("cov_"):
                table = with_column(table, name, pc.multiply(table[name], factor))
        return table

    return change


def swapped(table: pa.Table) -> pa.Table:
    """The likelier of the two poses becomes the less likely one."""
    return with_column(table, "probability", pc.subtract(1.0, table["probability"]))


def certain(table: pa.Table) -> pa.Table:
    """Each detection is stated to be a circle for certain."""
    ones = pc.if_else(pc.is_valid(table["confidence"]), 1.0, None)
    return with_column(table, "confidence", pc.cast(ones, pa.float64()))


CASES: dict[str, Change] = {
    "none": lambda table: table,
    "covariances times 1e-6": covariances(1e-6),
    "covariances times 0.7": covariances(0.7),
    "covariances times 1.5": covariances(1.5),
    "probabilities of the two poses swapped": swapped,
    "every confidence 1": certain,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, metavar="RUN")
    parser.add_argument("--baseline", type=Path, default=Path(__file__).parents[1] / "baseline.parquet")
    parser.add_argument("--out", type=Path, help="also write the table to this file")
    options = parser.parse_args()
    table = pq.read_table(options.run / "estimates" / ESTIMATES)
    lines = ["# Statements that are no longer true", "", "The same images and poses; only what is stated differs.", ""]
    lines += ["| change | exit status | what failed |", "|---|---|---|"]
    print("\n".join(lines))
    for name, change in CASES.items():
        with TemporaryDirectory() as folder:
            file = Path(folder) / ESTIMATES
            pq.write_table(change(table), file)
            report = Path(folder) / "report"
            code, output = said("validate", str(options.run / "dataset"), str(file), "--out", str(report))
            assert code == 0, output
            code, output = said("gate", str(report), "--baseline", str(options.baseline))
        lines.append(f"| {name} | {code} | {failed(output)} |")
        print(lines[-1], flush=True)
    if options.out:
        options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
