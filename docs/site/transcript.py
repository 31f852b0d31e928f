"""What of a command's output is shown in a tutorial, and when two outputs are the same.

The rule, for the pages and for the test that runs their commands elsewhere:

- Lines of progress, and the notice that the solver is compiled after an installation, are left out.
- Durations, p-values, sizes in bytes, and checksums of 12 digits and more are not compared.
- Other numbers may differ by 5 %, or by two units of their last digit: the last bits of a pixel depend on the
  processor's vector width, and a rare grey level with them.
- All other text is the same.
"""

from __future__ import annotations

import re

_TRANSIENT = re.compile(r"\w+: \d+ of \d+ frames, \d+ s|roundel: compiling the solver's inner loops.*")
_ANSI = re.compile(r"\x1b\[[0-9;]*m")
_NOT_COMPARED = re.compile(r"\b[0-9a-f]{12,}\b|\bp = [-+.e0-9]+|\b\d+(\.\d+)? ?(ms|s|kB|MB|GB)\b")
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_RELATIVE, _LAST_DIGITS = 0.05, 2


def shown(output: str) -> str:
    """The lines of an output that a page shows."""
    lines = [line.rstrip() for line in _ANSI.sub("", output).splitlines()]
    return "\n".join(line for line in lines if not _TRANSIENT.fullmatch(line)).strip("\n")


def difference(expected: str, found: str) -> str | None:
    """The first line in which two outputs differ by the rule above; None if they are the same.

    Parameters
    ----------
    expected, found : str
        As `shown` returns them.
    """
    left, right = expected.splitlines(), found.splitlines()
    for a, b in zip(left, right, strict=False):
        if not _same_line(a, b):
            return f"expected {a!r}, found {b!r}"
    if len(left) != len(right):
        return f"expected {len(left)} lines, found {len(right)}: {(left + right)[min(len(left), len(right))]!r}"
    return None


def _same_line(a: str, b: str) -> bool:
    a, b = (_NOT_COMPARED.sub("*", line) for line in (a, b))
    # Columns are as wide as their numbers.
    words = [" ".join(_NUMBER.sub("#", line).split()) for line in (a, b)]
    return words[0] == words[1] and all(
        _near(x, y) for x, y in zip(_NUMBER.findall(a), _NUMBER.findall(b), strict=True)
    )


def _near(a: str, b: str) -> bool:
    unit = max(_unit(a), _unit(b))
    return abs(float(a) - float(b)) <= max(_RELATIVE * abs(float(a)), _LAST_DIGITS * unit * (1 + 1e-9))


def _unit(number: str) -> float:
    """One unit of a number's last digit; 0 for a whole number, which is a count."""
    mantissa, _, exponent = number.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) if decimals or exponent else 0.0
