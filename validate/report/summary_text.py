"""Summary text of a report."""

from __future__ import annotations

import shlex
from typing import Any

from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.validate.scores.stated_uncertainty import ASKED, HOLDS, NARROW, OPEN, WIDE, region_text
from roundel.validate.scores.summary import CHESSBOARD, Summary, detected_without_pose, main_key, number

Run = dict[str, Any]


def main_run(summary: Summary) -> Run:
    """The main run of a report, see `main_key`."""
    runs = {(r["method"], r["intrinsics"], r["reference"]): r for r in summary.runs}
    main = main_key(list(runs), (summary.settings.get("solve") or {}).get("methods", []))
    assert main is not None, "a report scores at least one run against the truth"
    return runs[main]


def _errors(run: Run) -> str:
    oracle = run["oracle"]
    return (
        f"the normal is off by {number(oracle['normal_error_deg']['median'])}\N{DEGREE SIGN}, "
        f"the centre by {number(oracle['position_error_pct']['median'])} % of its distance, "
        f"and points reprojected around the marker by {number(oracle['reprojection_error_px']['median'])} px"
    )


def sentences(summary: Summary) -> list[str]:
    """The findings of a report, most important first."""
    data, main = summary.dataset, main_run(summary)
    runs = [r for r in summary.runs if r["reference"] == "truth" and r["method"] != CHESSBOARD]
    circles = "circle" if main["n"] == 1 else "circles"
    bare = detected_without_pose(main)
    found = [data["reference"]["sentence"]] if "reference" in data else []
    found += [
        f"Method {main['method']} found {main['solved'] + bare} of {main['n']} {circles} in {data['frames']} frames; "
        + _false_sentence(main)
    ]
    found += _failure_sentences(summary, main)
    if bare:
        found.append(_centre_sentence(main, bare))
    found += _pooled_sentences(data)
    if main["oracle"]["normal_error_deg"]["n"]:
        found.append(
            f"With {IntrinsicsLabel.of(main['intrinsics']).phrase}, {_errors(main)} (medians); in 95 % of frames "
            f"the normal is within {number(main['oracle']['normal_error_deg']['p95'])}\N{DEGREE SIGN}."
        )
    others = [
        r for r in runs if r["method"] == main["method"] and r is not main and r["oracle"]["normal_error_deg"]["n"]
    ]
    wrong = [r for r in others if not IntrinsicsLabel.of(r["intrinsics"]).is_right]
    if wrong:
        first = next((r for r in wrong if r["intrinsics"].startswith("default")), None)
        other = first or max(wrong, key=lambda r: r["oracle"]["position_error_pct"]["median"])
        found.append(
            f"With {IntrinsicsLabel.of(other['intrinsics']).phrase}, {_errors(other)}. A focal length that is wrong by "
            "a factor scales the marker's distance by that factor; points reprojected with the same intrinsics are "
            "affected less, and less still at larger distances."
        )
    if main["solved"]:
        found.append(_choice_sentence(main))
    stated = main["coverage"]["oracle"]
    if stated:
        found.append(f"Do its 95 % regions hold the truth? {_region_sentence(stated)}")
    found.extend(_calibration_sentences(summary))
    return found


_REGIONS = {
    HOLDS: "Yes",
    NARROW: "No, they are too narrow",
    WIDE: "No, they are too wide",
    OPEN: "These frames cannot decide",
}


def _region_sentence(found: dict[str, Any]) -> str:
    return f"{_REGIONS[found['verdict']]}: {region_text(found)} ({ASKED} asked for)."


def _false_sentence(run: Run) -> str:
    count = run["false_detections"]
    if not count:
        return "there are no false positives."
    return "1 detection is a false positive." if count == 1 else f"{count} detections are false positives."


def _failure_sentences(summary: Summary, run: Run, most: int = 3) -> list[str]:
    """Why circles of a run have no pose: its most frequent reasons."""
    mine = [f for f in summary.failures if all(f[key] == run[key] for key in ("method", "intrinsics", "reference"))]
    if not mine:
        return []
    mine.sort(key=lambda f: (-f["count"], f["reason"]))
    named = "; ".join(f"{f['reason']} ({f['count']})" for f in mine[:most])
    more = sum(f["count"] for f in mine[most:])
    return [f"Circles without a pose, by reason: {named}{f'; others ({more})' if more else ''}."]


def _pooled_sentences(data: dict[str, Any]) -> list[str]:
    """That the numbers of a report are over all levels of a sweep."""
    several = len(data["groups"]) > 1
    return [
        f"These numbers are over all levels of {key}{f' in group {group}' if several else ''}, pooled; the section on "
        "its levels tells them apart."
        for group, key in (data.get("sweeps") or {}).items()
    ]


def _centre_sentence(run: Run, bare: int) -> str:
    image, ellipse = run["oracle"]["centre_image_error_px"], run["ellipse"]["ellipse_centre_error_px"]
    whose = "It gives no poses" if not run["solved"] else f"It gave no pose for {bare} of them"
    return (
        f"{whose}. The median distance of its centres is {number(image['median'])} px to the image of the circle's "
        f"centre and {number(ellipse['median'])} px to the centre of its ellipse."
    )


def _choice_sentence(run: Run) -> str:
    head = (
        "Two poses explain one image of a circle equally well. All errors here are those of the better candidate, the "
        "pose nearer to the truth"
    )
    if not run["branch_chosen"]:
        return f"{head}; none was chosen, because no prior knowledge was given."
    share = 100 * run["branch_correct"] / run["branch_chosen"]
    return f"{head}; the solver chose one in {run['branch_chosen']} frames and was right in {number(share)} % of them."


def _calibration_sentences(summary: Summary) -> list[str]:
    found = []
    calibration = summary.calibration
    if calibration is not None and "rms_px" in calibration:
        text = (
            f"OpenCV calibrated the camera from {calibration['views']} chessboard views with an RMS of "
            f"{number(calibration['rms_px'])} px"
        )
        if "fx_error_pct" in calibration:
            text += f"; its focal length is off by {number(abs(calibration['fx_error_pct']))} %"
        if "projection_mean_px" in calibration:
            share = calibration["projection_share"]
            over = "the whole image" if share == 1 else f"the {number(100 * share)} % of the image that it covers"
            text += f"; its mean projection error over {over} is {number(calibration['projection_mean_px'])} px"
        found.append(text + ".")
    board = next((r for r in summary.runs if r["method"] == CHESSBOARD), None)
    if board is not None and board["oracle"]["normal_error_deg"]["n"]:
        found.append(
            f"The poses of the chessboard itself, found in {board['solved']} of {board['n']} views, have median errors "
            f"of {number(board['oracle']['normal_error_deg']['median'])}\N{DEGREE SIGN} and "
            f"{number(board['oracle']['position_error_pct']['median'])} % of the distance: these errors limit the "
            "board as a reference."
        )
    return found


def commands(summary: Summary) -> list[str]:
    """The commands that reproduce this report; names in capitals are placeholders."""
    runs = [r for r in summary.runs if r["method"] != CHESSBOARD]
    methods = list(dict.fromkeys(r["method"] for r in runs))
    labels = list(dict.fromkeys(r["intrinsics"] for r in runs))
    imported = "reference" in summary.dataset
    lines = ["roundel import PHOTOS DATASET --sheet SHEET" if imported else "roundel render DATASET/study.yaml DATASET"]
    settings, camera = summary.settings, ""
    reference = settings.get("reference_intrinsics") or ""
    for label in dict.fromkeys(x for x in (*labels, reference) if x.startswith("calibrated:")):
        camera = shlex.quote(f"{label.partition(':')[2]}.json")
        views = IntrinsicsLabel.of(label).views
        lines.append(f"roundel calibrate DATASET {camera}" + (f" --views {views}" if views else ""))
    options = "".join(f" --method {shlex.quote(m)}" for m in methods)
    for label in labels:
        value = f"{label}.json" if label.startswith("calibrated:") else label
        options += f" --intrinsics {shlex.quote(value)}"
    lines.append(f"roundel solve DATASET ESTIMATES{options}")
    extent = settings["reprojection_extent_D"]
    option = f" --extent-D {extent:g}" if extent != 3 else ""
    option += f" --camera {camera}" if reference.startswith("calibrated:") else ""
    lines.append(f"roundel validate DATASET ESTIMATES --out REPORT{option}")
    return lines
