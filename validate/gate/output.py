"""Output of the gate: lines of text, JUnit XML, a Markdown summary."""

from __future__ import annotations

import math
import shlex
import xml.etree.ElementTree as ET
from collections import Counter

from roundel.validate.gate.checks import Check
from roundel.validate.gate.gate import Frame, GateResult

# GitHub discards a step summary that is larger than 1,024 kB.
SUMMARY_LIMIT_BYTES = 1_000_000
_FEW = 200  # failed checks that are listed before the circles


def replay_command(frame: Frame, solvable: frozenset[str] | None = None) -> str:
    """The command that solves this frame again; for a method that cannot be solved, the one that shows the frame.

    Parameters
    ----------
    frame : Frame
    solvable : frozenset of str, optional
        The methods that `roundel solve` knows; default: all.
    """
    method, intrinsics = frame.run.split(", ", 1)
    if solvable is not None and method not in solvable:
        place = f"PAGE/index.html#frame-{frame.frame_id}; frame_id {frame.frame_id} in the file of {method}"
        return f"roundel browse DATASET REPORT --out PAGE  # then open {' '.join(place.split())}"
    frames = f"{frame.frame_id}:{frame.frame_id + 1}"
    if intrinsics.startswith("calibrated:"):
        intrinsics += ".json"  # a run's label contains only the name of its camera file
    words = ["--frames", frames, "--method", method, "--intrinsics", intrinsics]
    return f"roundel solve DATASET OUT {shlex.join(words)}"


def lines(result: GateResult) -> list[str]:
    """The verdict for a terminal: failed checks first, then the others, then the circles with the largest losses.

    Groups in which nothing changed are counted, not listed.
    """
    quiet = Counter(check.run for check in result.checks if check.group and check.verdict == "same")
    shown = [check for check in _worst_first(result) if not check.group or check.verdict != "same"]
    out = [f"{check.verdict:9s} {check.run}: {check.sentence}" for check in shown]
    out += [f"{'same':9s} {run}: {count} checks of single groups" for run, count in quiet.items()]
    if not result.passed and result.worst:
        out.append("circles with the largest losses:")
        out += [
            f"  {_place(frame)}: {frame.sentence}    {replay_command(frame, result.solvable)}" for frame in result.worst
        ]
    out += result.notes
    worse = sum(check.verdict == "worse" for check in result.checks)
    return [*out, "gate: passed" if result.passed else f"gate: WORSE in {worse} of {len(result.checks)} checks"]


def _worst_first(result: GateResult) -> list[Check]:
    order = {"worse": 0, "better": 1, "same": 2, "identical": 3}
    return sorted(result.checks, key=lambda check: order[check.verdict])


def _place(frame: Frame) -> str:
    return f"frame {frame.frame_id}, marker {frame.marker_id} ({frame.run})"


def junit_xml(result: GateResult, suite: str = "roundel gate") -> bytes:
    """JUnit XML: one test case per check. All times are 0, so that the same verdict has the same bytes."""
    worse = [check for check in result.checks if check.verdict == "worse"]
    counts = {"tests": str(len(result.checks)), "failures": str(len(worse)), "errors": "0", "time": "0"}
    root = ET.Element("testsuites", counts)
    node = ET.SubElement(root, "testsuite", {"name": suite, **counts, "skipped": "0"})
    for check in result.checks:
        case = ET.SubElement(
            node, "testcase", {"classname": _plain(check.run), "name": _plain(check.name), "time": "0"}
        )
        if check.verdict == "worse":
            about = {"message": _plain(check.sentence), "type": "worse"}
            ET.SubElement(case, "failure", about).text = _plain(_details(check, result))
        else:
            ET.SubElement(case, "system-out").text = _plain(check.sentence)
    return _written(root)


def refused_xml(reason: str, suite: str = "roundel gate") -> bytes:
    """JUnit XML of a refused comparison: one test case with an error."""
    counts = {"tests": "1", "failures": "0", "errors": "1", "time": "0"}
    root = ET.Element("testsuites", counts)
    node = ET.SubElement(root, "testsuite", {"name": suite, **counts, "skipped": "0"})
    case = ET.SubElement(node, "testcase", {"classname": suite, "name": "comparison", "time": "0"})
    ET.SubElement(case, "error", {"message": _plain(reason), "type": "not comparable"})
    return _written(root)


def _written(root: ET.Element) -> bytes:
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _details(check: Check, result: GateResult) -> str:
    mine = [frame for frame in result.worst if frame.run == check.run]
    return "\n".join(
        [check.sentence, *(f"{_place(f)}: {f.sentence}; {replay_command(f, result.solvable)}" for f in mine)]
    )


def _plain(text: str) -> str:
    """The text without control characters, which XML 1.0 cannot represent."""
    return "".join(c if c in "\n\t" or ord(c) >= 32 else "?" for c in text)


def markdown(result: GateResult) -> str:
    """A step summary in Markdown, always below GitHub's size limit; failed checks come first."""
    checks = _worst_first(result)
    worse = [check for check in checks if check.verdict == "worse"]
    out = [f"## Roundel gate: {'**worse**' if worse else 'passed'}", ""]
    if worse:
        out += [*_table(worse[:_FEW]), *([f"and {len(worse) - _FEW} more"] if len(worse) > _FEW else []), ""]
    if worse and result.worst:
        out += ["### Circles with the largest losses", "", "| circle | error | replay |", "|---|---|---|"]
        out += [
            f"| {_cell(_place(f))} | {_cell(f.sentence)} | `{_cell(replay_command(f, result.solvable))}` |"
            for f in result.worst
        ]
        out += ["", "### Other checks", ""]
    out += [*_table(checks[len(worse) :]), "", *(f"- {_cell(note)}" for note in result.notes)]
    kept: list[str] = []
    size = 0
    for line in out:
        size += len(line.encode()) + 1
        if size > SUMMARY_LIMIT_BYTES - 100:
            kept.append("\n(truncated: GitHub discards longer summaries)")
            break
        kept.append(line)
    return "\n".join(kept).rstrip() + "\n"


def refused_markdown(reason: str) -> str:
    """A step summary of a refused comparison."""
    return f"## Roundel gate: **nothing compared**\n\n{_cell(reason)}\n"


def _table(checks: list[Check]) -> list[str]:
    if not checks:
        return []
    out = ["| verdict | run | check | figure | p |", "|---|---|---|---|---|"]
    for check in checks:
        p = "" if math.isnan(check.p_value) else f"{check.p_value:.2g}"
        out.append("| " + " | ".join(map(_cell, (check.verdict, check.run, check.name, check.sentence, p))) + " |")
    return out


def _cell(text: str) -> str:
    """Text escaped for a table cell: no pipes, tags, code or line breaks."""
    escaped = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return " ".join(escaped.replace("|", "\\|").replace("`", "'").split())
