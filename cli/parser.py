"""All verbs and their arguments. Only argparse is imported, so that `roundel --help` is fast."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from roundel.cli.arguments import (
    EstimatesSchema,
    ListMethods,
    count,
    frame_range,
    on_disk,
    part_of,
    positive,
)
from roundel.cli.calibration.arguments import add_calibrate
from roundel.cli.export_arguments import add_export
from roundel.cli.ingest.arguments import add_import
from roundel.cli.usage import Parser

EXIT_STATUS = (
    "exit status: 0 success, 1 gate failed, 2 usage or study error, 3 not comparable or too few samples, "
    "4 run-time failure or corrupt data, 130 interrupted"
)
SHELLS = ("bash", "zsh", "fish")
# Those of `roundel.render.backend`, which is not imported here.
BACKENDS = ("llvm", "cuda", "auto")

# Takes a verb's name and its line of help, returns its parser.
AddVerb = Callable[[str, str], argparse.ArgumentParser]

_STUDY = "a YAML file, or the name of a shipped study (see `roundel studies`)"
_DATASET = "dataset: its folder, or an address such as s3://bucket/name"
_REPORT = "folder of a report, written by `roundel validate`"
_OUT = "folder to write to"
_METHOD_FILE = "a function in your own file, path/to/file.py:find"


def build_parser() -> argparse.ArgumentParser:
    """The command's parser, with a parser for each verb."""
    parser = Parser(
        prog="roundel",
        description="Ray-traced datasets of circular markers with exact ground truth, single-circle pose estimation "
        "and its validation.",
        epilog=EXIT_STATUS,
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB")

    def add(name: str, text: str) -> argparse.ArgumentParser:
        return verbs.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".", epilog=EXIT_STATUS)

    _add_studies(add)
    _add_rendering(add)
    add_export(add)
    add_import(add)
    _add_solving(add)
    add_calibrate(add)
    _add_scoring(add)
    _add_league(add)
    _add_gate(add)
    _add_tools(add)
    return parser


def _add_studies(add: AddVerb) -> None:
    check = add("check", "check a study and print its resolved form, its frames and its cost")
    check.add_argument("study", nargs="?", metavar="STUDY", help=_STUDY)
    check.add_argument("--schema", action="store_true", help="print the JSON Schema of a study instead")
    check.add_argument("--cache-key", action="store_true", help="print a key for caching the rendered dataset in CI")

    preview = add("preview", "render a few small frames of a study with few rays: a contact sheet and a page")
    preview.add_argument("study", metavar="STUDY", help=_STUDY)
    preview.add_argument(
        "out", nargs="?", type=on_disk, metavar="OUT", help="folder to write to (default: STUDY-preview, here)"
    )

    studies = add("studies", "list the shipped studies, or print one")
    studies.add_argument("name", nargs="?", metavar="NAME", help="print this study instead of the list")

    init = add("init", "write a commented study to start from")
    init.add_argument("file", metavar="FILE", help="file to write; an existing file is never overwritten")
    init.add_argument("--from", dest="source", metavar="NAME", help="start from this shipped study")


def _add_rendering(add: AddVerb) -> None:
    render = add("render", "render a study to a dataset; resumes automatically")
    render.add_argument("study", metavar="STUDY", help=_STUDY)
    render.add_argument(
        "dataset",
        metavar="DATASET",
        help="folder, or address such as s3://bucket/name, to write to; a partial dataset is completed",
    )
    render.add_argument("--frames", type=frame_range, metavar="A:B", help="only these frames")
    render.add_argument(
        "--slice", type=part_of, metavar="I/N", help="only the I-th of N equal parts, I from 1 (0 is the same as N)"
    )

    run = add("run", "render, solve and validate a study: OUT/dataset, OUT/estimates, OUT/report")
    run.add_argument("study", metavar="STUDY", help=_STUDY)
    run.add_argument("out", type=on_disk, metavar="OUT", help=_OUT)
    run.add_argument(
        "--method",
        action="append",
        metavar="NAME",
        help=f"instead of the study's methods: a name from `roundel solve --list-methods`, or {_METHOD_FILE}; "
        "repeatable",
    )
    for parser in (render, run):
        parser.add_argument(
            "--jobs",
            type=count,
            default=1,
            metavar="N",
            help="number of processes (default 1; one process uses all cores)",
        )
        _add_scheduler(parser)
        _add_mixing(parser)
        parser.add_argument(
            "--threads", type=count, metavar="N", help="threads per process (default: all cores, divided by --jobs)"
        )
        parser.add_argument(
            "--backend",
            choices=BACKENDS,
            default=BACKENDS[0],
            metavar="BACKEND",
            help="llvm (default): the processor, bit-identical on every run; cuda: an NVIDIA GPU; auto: cuda where a "
            "GPU is usable, else llvm",
        )

    develop = add("develop", "re-expose a dataset's radiance for another sensor, or several, without rendering")
    develop.add_argument("dataset", metavar="DATASET", help=_DATASET)
    develop.add_argument("out", metavar="OUT", help="folder, or address, of the new dataset")
    develop.add_argument(
        "--sensor",
        required=True,
        metavar="FILE",
        help="YAML file with keys of a `sensor:` section, merged over those of each group; a `sweep:` over one of them "
        "repeats every frame at each level",
    )

    develop.add_argument(
        "--no-radiance",
        action="store_true",
        help="leave out the radiance, nine tenths of the bytes; the new dataset cannot be developed again",
    )
    _add_jobs(develop)

    verify = add(
        "verify", "check the integrity of a dataset or an export, and print a dataset's fidelity; writes nothing"
    )
    verify.add_argument("dataset", metavar="DATASET", help=f"{_DATASET}; or an export")
    verify.add_argument("--full", action="store_true", help="also compute every checksum and decode every image")
    verify.add_argument(
        "--against", metavar="DATASET", help="for an export: read every frame back and compare it with this dataset"
    )

    repair = add("repair", "restore what `verify --full` finds: altered files, damaged records, leftovers")
    repair.add_argument("dataset", metavar="DATASET", help=f"{_DATASET}; no other process may be rendering into it")
    repair.add_argument("--study", metavar="STUDY", help="the study, if the dataset's own copies of it are lost")

    merge = add("merge", "join datasets that hold parts of the same study, rendered on machines without a shared disk")
    merge.add_argument(
        "parts", metavar="PART", nargs="+", help="folder or address of a part, from `roundel render --slice`"
    )
    merge.add_argument(
        "out", metavar="DATASET", help="folder or address to write to: a new one, or a part of the same study"
    )

    pull = add("pull", "fetch a dataset, or some of its frames, from an object store, a web server or another folder")
    pull.add_argument("dataset", metavar="ADDRESS", help="such as s3://bucket/name or https://host/name, or a folder")
    pull.add_argument("out", metavar="DATASET", help="folder to write to; what is there already is kept")
    pull.add_argument(
        "--frames", type=frame_range, metavar="A:B", help="only these frames, in addition to those that are there"
    )
    for parser in (repair, merge):
        _add_mixing(parser)


def _add_jobs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--jobs",
        type=count,
        default=1,
        metavar="N",
        help="number of processes (default 1); the results do not depend on it",
    )
    _add_scheduler(parser)


def _add_scheduler(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="address of a Dask scheduler, such as tcp://10.0.0.1:8786: its workers do the work, and share the disk",
    )


def _add_mixing(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--mix-environments",
        action="store_true",
        help="keep frames that another version or machine rendered, whose last bits may differ",
    )


def _add_solving(add: AddVerb) -> None:
    solve = add("solve", "estimate the pose of every circle in a dataset, in photographs, or in a video")
    solve.add_argument(
        "inputs", metavar="INPUT", nargs="+", help="a dataset; image files, folders of them, or patterns; or a video"
    )
    solve.add_argument("out", type=on_disk, metavar="OUT", help=_OUT)
    solve.add_argument(
        "--diameter-m",
        type=positive,
        metavar="D",
        help="outer diameter of the printed circles; required for photographs and videos",
    )
    solve.add_argument(
        "--method",
        action="append",
        metavar="NAME",
        help=f"pixels (default), ml, guaranteed, direct, edgedrawing, a name from --list-methods, or {_METHOD_FILE}; "
        "repeatable",
    )
    solve.add_argument(
        "--list-methods", action=ListMethods, nargs=0, help="print all methods, including those of installed packages"
    )
    solve.add_argument(
        "--intrinsics",
        action="append",
        metavar="SPEC",
        help="true, default, default:width, default:crop43, default:2020s, exif, focal:3100+-60 (px), "
        "focal35:26+-1 (mm), scaled:0.7, calibrated:FILE; repeatable (default: the study's; for photographs exif, else "
        "default)",
    )
    solve.add_argument(
        "--curve",
        metavar="CURVE",
        help="response curve of photographs and videos: linear, srgb, gamma:2.2, or estimate, from the edges of the "
        "circles (default: what the file says, else sRGB)",
    )
    solve.add_argument(
        "--linear", dest="curve", action="store_const", const="linear", help="the same as --curve linear"
    )
    solve.add_argument("--frames", type=frame_range, metavar="A:B", help="only these frames of a dataset")
    solve.add_argument("--group", action="append", metavar="GROUP", help="only this group; repeatable")
    _add_jobs(solve)
    solve.add_argument(
        "--knowledge",
        metavar="WORDS",
        help="prior knowledge of the pose: same_side, opposite_side, normal:X,Y,Z:SPREAD_DEG, floor, wall, ceiling, "
        "circle:RATIO, tick, coplanar (all circles in one plane, of one size); combine several with + (default: none, "
        "both poses are equally likely)",
    )


def _add_scoring(add: AddVerb) -> None:
    validate = add("validate", "score estimates against the truth")
    validate.add_argument("dataset", metavar="DATASET", help=_DATASET)
    validate.add_argument(
        "estimates", metavar="ESTIMATES", nargs="+", help="folders written by `roundel solve`, or files of estimates"
    )
    validate.add_argument("--out", type=on_disk, required=True, metavar="REPORT", help="folder to write the report to")
    validate.add_argument(
        "--schema",
        action=EstimatesSchema,
        nargs=0,
        help="print the required and optional columns of a file of estimates",
    )
    validate.add_argument(
        "--extent-D", type=positive, metavar="D", help="half side of the reprojection grid (default: the study's)"
    )
    validate.add_argument(
        "--camera", metavar="FILE", help="calibrated camera, for the pose of a chessboard beside the marker"
    )
    _add_jobs(validate)

    compare = add(
        "compare", "write one page over several reports, paired by frame if they share a dataset or its radiance"
    )
    compare.add_argument(
        "reports", metavar="REPORT", nargs="+", help="folders of reports; the others are compared with the first"
    )
    compare.add_argument("--out", type=on_disk, required=True, metavar="FOLDER", help="folder to write the page to")

    browse = add("browse", "write a page of all frames: thumbnails, true contours, filters over truth and scores")
    browse.add_argument("dataset", metavar="DATASET", help=_DATASET)
    browse.add_argument("report", nargs="?", metavar="REPORT", help=f"{_REPORT}, for its scores")
    browse.add_argument(
        "--out",
        type=on_disk,
        required=True,
        metavar="FOLDER",
        help="folder to write the page to; an older page is replaced",
    )
    browse.add_argument("--images", action="store_true", help="also copy the images, for the larger view")


def _add_league(add: AddVerb) -> None:
    league = add("league", "run every related system on the same images, or score a submission")
    actions = league.add_subparsers(dest="action", metavar="ACTION", required=True, help="run, score, or hold-back")

    def action(name: str, text: str) -> argparse.ArgumentParser:
        return actions.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".", epilog=EXIT_STATUS)

    run = action("run", "render the league, solve it with every installed entry, write its page; resumes automatically")
    run.add_argument("out", type=on_disk, metavar="OUT", help="folder to write to: dataset, estimates, league")
    run.add_argument("--study", default="league", metavar="STUDY", help=f"{_STUDY} (default: league)")
    run.add_argument("--dataset", metavar="DATASET", help="solve this dataset instead of rendering the study")
    run.add_argument("--jobs", type=count, default=1, metavar="N", help="number of processes that render (default 1)")

    score = action("score", "score a file of estimates like every other entry")
    score.add_argument("submission", metavar="SUBMISSION", help="CSV or Parquet, see `roundel validate --schema`")
    score.add_argument(
        "--dataset", required=True, metavar="DATASET", help="the league's dataset, or its held-back part"
    )
    score.add_argument("--against", metavar="LEAGUE", help="folder of the published league, to compare with")
    score.add_argument("--name", metavar="NAME", help="name of the entry (default: the method's)")
    score.add_argument("--out", type=on_disk, required=True, metavar="FOLDER", help="folder to write the page to")
    for parser in (run, score):
        parser.add_argument("--truth", metavar="KEPT", help="the truth of a held-back dataset, from `league hold-back`")

    hold = action("hold-back", "split a dataset into images to publish and a truth to keep")
    hold.add_argument("dataset", metavar="DATASET", help=_DATASET)
    hold.add_argument("public", metavar="PUBLIC", help="folder to publish: images and cameras")
    hold.add_argument("kept", metavar="KEPT", help="folder to keep: truth, salt and study")


def _add_gate(add: AddVerb) -> None:
    gate = add("gate", "compare a report with a baseline; exits with status 1 if it is worse")
    gate.add_argument("report", metavar="REPORT", help=_REPORT)
    gate.add_argument("--baseline", required=True, metavar="FILE", help="the baseline, from `roundel baseline accept`")
    gate.add_argument("--junit", metavar="FILE", help="also write the checks as JUnit XML")

    baseline = add("baseline", "accept the scores of a report as the baseline for later reports, or print its history")
    actions = baseline.add_subparsers(dest="action", metavar="ACTION", required=True, help="accept, or log")
    text = "write the scores of a report as the baseline"
    accept = actions.add_parser("accept", help=text, description=f"{text.capitalize()}.", epilog=EXIT_STATUS)
    accept.add_argument("report", metavar="REPORT", help=_REPORT)
    accept.add_argument("--baseline", required=True, metavar="FILE", help="file to write; replaces an older baseline")
    accept.add_argument(
        "--reason", required=True, metavar="TEXT", help="why these scores are right; stored in the baseline"
    )
    text = "print why each version of a baseline was accepted, the newest last"
    log = actions.add_parser("log", help=text, description=f"{text.capitalize()}.", epilog=EXIT_STATUS)
    log.add_argument("baseline", metavar="FILE", help="the baseline")


def _add_tools(add: AddVerb) -> None:
    marker = add("marker", "write a marker for printing, to scale, with a ruler to check the printer")
    marker.add_argument(
        "kind",
        metavar="KIND",
        help="disc, disc_with_tick, ring, rings, coded_rings, ring_code, dot_code, two_discs, dot_ring, "
        "disc_with_chessboard, disc_with_charuco, chessboard, circle_grid, charuco, tags, stag",
    )
    marker.add_argument("out", type=on_disk, metavar="OUT", help="file to write, .pdf or .svg")
    marker.add_argument("--diameter-m", type=positive, metavar="D", help="diameter of the circle (default 0.08)")
    marker.add_argument("--paper", default="a4", metavar="NAME", help="a5, a4 (default), a3, letter, legal, tabloid")
    marker.add_argument(
        "--set",
        action="append",
        metavar="KEY=VALUE",
        help="a key of the marker's section, for example inner_diameter_m=0.05",
    )

    add("doctor", "print versions, the renderer's backend, and problems with their solutions")

    completion = add("completion", "print the shell completion script")
    completion.add_argument(
        "shell",
        choices=SHELLS,
        metavar="SHELL",
        help='bash, zsh or fish; load it with `eval "$(roundel completion bash)"` or `roundel completion fish|source`',
    )
