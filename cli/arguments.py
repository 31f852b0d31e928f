"""Types of arguments, and options that print and exit."""

from __future__ import annotations

import argparse
import os
import sys


def frame_range(text: str) -> range:
    """Frames `A:B`, from A to B - 1; a single number is that frame."""
    start, colon, stop = text.partition(":")
    try:
        frames = range(int(start or 0), int(stop) if stop else int(start) + 1 if not colon else sys.maxsize)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: give frames as A:B, from A to B - 1, for example 0:100") from None
    if frames.start < 0 or len(frames) == 0:
        raise argparse.ArgumentTypeError(f"{text!r}: no frames in this range; give A:B with A smaller than B")
    return frames


def part_of(text: str) -> tuple[int, int]:
    """A slice `I/N`: I counts from 1 to N, and 0 is the same as N, for those who count from 0."""
    number, slash, count = text.partition("/")
    if not (slash and number.isascii() and number.isdecimal() and count.isascii() and count.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r}: give a slice as I/N, for example 7/1000")
    if not 0 <= int(number) <= int(count) or int(count) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: slices of {count} are 1/{count} to {count}/{count}")
    return int(number) or int(count), int(count)


def count(text: str) -> int:
    """A whole number, 1 or more."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: give a whole number, 1 or more")
    return value


def positive(text: str) -> float:
    """A finite number above zero."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r}: give a positive number")
    return value


def views(text: str) -> int:
    """A number of views, in plain digits: it becomes part of a label."""
    if not (text.isascii() and text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r}: give a number of views, for example 20")
    return int(text)


def bend(text: str) -> int:
    """The order of a board's bend."""
    if text not in ("2", "3", "4", "5", "6"):
        raise argparse.ArgumentTypeError(f"{text!r}: give an order from 2 (a simple curve) to 6 (waves)")
    return int(text)


def grid(text: str) -> tuple[int, int]:
    """Columns and rows, such as 7x5."""
    columns, _, rows = text.lower().partition("x")
    if not (columns.isdecimal() and rows.isdecimal() and int(columns) > 1 and int(rows) > 1):
        raise argparse.ArgumentTypeError(f"{text!r}: give columns and rows, for example 7x5")
    return int(columns), int(rows)


def on_disk(text: str) -> str:
    """A folder or file of this machine, not an address: estimates and reports are written to disks."""
    if "://" in text:
        raise argparse.ArgumentTypeError(f"{text}: estimates, reports and pages are written to a disk; give a folder")
    return text


def leave_stdout() -> None:
    """Discard further output: the reader closed the pipe (`roundel check | head`), which is not an error."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class _PrintAndExit(argparse.Action):
    """Prints a text and exits before the other arguments are required, like --help."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        try:
            print(self.text(), flush=True)
        except BrokenPipeError:
            leave_stdout()
        parser.exit()

    def text(self) -> str:
        raise NotImplementedError


class ListMethods(_PrintAndExit):
    """Prints the methods of `solve`."""

    def text(self) -> str:
        """One line per method."""
        from roundel.solver.methods.registry import method_lines

        return "\n".join(method_lines())


class EstimatesSchema(_PrintAndExit):
    """Prints the columns of a file of estimates."""

    def text(self) -> str:
        """A table in Markdown."""
        from roundel.validate.estimates.schema import columns_markdown

        return columns_markdown()
