"""The `roundel` command: arguments in, exit codes out. Rooms are imported by the verb that needs them."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Callable, Sequence

EXIT_CODES = """exit codes: 0 well, 1 worse (gate), 2 usage or study error, 3 not comparable or too few samples,
4 run-time failure or corrupt data, 130 interrupted"""


_STUDY_HELP = "a YAML file, or the name of a shipped study (see `roundel studies`)"


def _frames(text: str) -> range:
    start, colon, stop = text.partition(":")
    try:
        frames = range(int(start or 0), int(stop) if stop else int(start) + 1 if not colon else sys.maxsize)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r}: frames are A:B, from A up to but not with B, as in 0:100"
        ) from None
    if frames.start < 0 or len(frames) == 0:
        raise argparse.ArgumentTypeError(f"{text!r}: no frames in this range; give A:B with A smaller than B")
    return frames


def _count(text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: give a whole number, 1 or more")
    return value


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r}: give a positive number")
    return value


def _views(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"{text!r}: give a number of views, as 20")
    return int(text)


def _say(text: str) -> None:
    try:
        print(text, flush=True)
    except BrokenPipeError:
        _leave_stdout()


def _leave_stdout() -> None:
    """The reader of our output went away (`roundel check | head`); nothing is wrong."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class _ListMethods(argparse.Action):
    """Prints the methods and ends, as --help does: before the other arguments are asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        from roundel.solver.methods.registry import method_lines

        _say("\n".join(method_lines()))
        parser.exit()


class _EstimatesSchema(argparse.Action):
    """Prints the columns of a file of estimates and ends, as --help does."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        from roundel.validate.estimates.schema import columns_markdown

        _say(columns_markdown())
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """All verbs and their arguments; imports nothing but argparse."""
    parser = argparse.ArgumentParser(
        prog="roundel",
        description="Ray-traced datasets of circular markers, exact truth, single-circle pose, and its validation.",
        epilog=EXIT_CODES,
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB")

    def verb(name: str, text: str) -> argparse.ArgumentParser:
        return verbs.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".", epilog=EXIT_CODES)

    def rendering(one: argparse.ArgumentParser) -> None:
        one.add_argument(
            "--jobs", type=_count, default=1, metavar="N", help="processes (default 1; one uses all cores)"
        )
        one.add_argument("--threads", type=_count, metavar="N", help="threads a process (default: all cores)")

    check = verb("check", "read a study, print it resolved, its frames and its cost")
    check.add_argument("study", nargs="?", metavar="STUDY", help=_STUDY_HELP)
    check.add_argument("--schema", action="store_true", help="print the JSON Schema of a study instead")

    studies = verb("studies", "list the shipped studies, or print one")
    studies.add_argument("name", nargs="?", metavar="NAME", help="print this study instead of the list")

    init = verb("init", "write a commented study to start from")
    init.add_argument("file", metavar="FILE", help="where to write it; an existing file is never overwritten")
    init.add_argument("--from", dest="source", metavar="NAME", help="start from this shipped study")

    render = verb("render", "render a study to a dataset; resumes by itself")
    render.add_argument("study", metavar="STUDY", help=_STUDY_HELP)
    render.add_argument("dataset", metavar="DATASET")
    render.add_argument("--frames", type=_frames, metavar="A:B", help="only these frames")
    rendering(render)

    develop = verb("develop", "expose a dataset's radiance anew, for another sensor, without rendering")
    develop.add_argument("dataset", metavar="DATASET")
    develop.add_argument("out", metavar="OUT")
    develop.add_argument(
        "--sensor", required=True, metavar="FILE", help="YAML: keys of a `sensor:` section, laid over each group's own"
    )

    solve = verb("solve", "estimate the pose of every circle in a dataset, or in photographs")
    solve.add_argument("inputs", metavar="INPUT", nargs="+", help="a dataset, or image files")
    solve.add_argument("out", metavar="OUT", help="folder to write to")
    solve.add_argument(
        "--diameter-m", type=_positive, metavar="D", help="outer diameter of the printed circles; photographs need it"
    )
    solve.add_argument(
        "--method",
        action="append",
        metavar="NAME",
        help="pixels (default), ml, guaranteed, direct, edgedrawing, or one that --list-methods names; may repeat",
    )
    solve.add_argument(
        "--list-methods", action=_ListMethods, nargs=0, help="print all methods, those of installed packages too"
    )
    solve.add_argument(
        "--intrinsics",
        action="append",
        metavar="SPEC",
        help="true, default, default:width, default:crop43, exif, focal:3100+-60 (px), focal35:26+-1 (mm), scaled:0.7, "
        "calibrated:FILE; may repeat (default: the study's; for photographs exif, else default)",
    )
    solve.add_argument(
        "--linear", action="store_true", help="photographs whose pixels are proportional to light (default: sRGB)"
    )
    solve.add_argument("--frames", type=_frames, metavar="A:B", help="only these frames of a dataset")
    solve.add_argument("--group", action="append", metavar="GROUP", help="only this group; may repeat")
    solve.add_argument(
        "--knowledge",
        metavar="WORDS",
        help="what is known of the pose: same_side, opposite_side, normal:X,Y,Z:SPREAD_DEG, floor, wall, ceiling, "
        "circle:RATIO; several joined by + (default: none, both poses are equally likely)",
    )

    validate = verb("validate", "score estimates against the truth")
    validate.add_argument("dataset", metavar="DATASET")
    validate.add_argument("estimates", metavar="ESTIMATES", nargs="+")
    validate.add_argument("--out", required=True, metavar="REPORT")
    validate.add_argument(
        "--schema", action=_EstimatesSchema, nargs=0, help="print what a file of estimates must and may hold"
    )
    validate.add_argument(
        "--extent-D", type=_positive, metavar="D", help="half side of the reprojection grid (default: the study's)"
    )
    validate.add_argument(
        "--camera", metavar="FILE", help="calibrated camera, for the pose of a chessboard beside the marker"
    )

    gate = verb("gate", "compare a report with a baseline; ends with 1 when it is worse")
    gate.add_argument("report", metavar="REPORT")
    gate.add_argument("--baseline", required=True, metavar="FILE")
    gate.add_argument("--junit", metavar="FILE", help="write the checks as JUnit XML, too")

    baseline = verb("baseline", "accept the scores of a report as the baseline of later ones")
    baseline.add_argument("action", choices=("accept",))
    baseline.add_argument("report", metavar="REPORT")
    baseline.add_argument("--baseline", required=True, metavar="FILE")
    baseline.add_argument("--reason", required=True, metavar="TEXT", help="why these scores are right; kept in it")

    compare = verb("compare", "write one page over several reports, paired by frame where they are of one dataset")
    compare.add_argument("reports", metavar="REPORT", nargs="+", help="the first is what the others are compared with")
    compare.add_argument("--out", required=True, metavar="FOLDER")

    run = verb("run", "render, solve and validate a study: OUT/dataset, OUT/estimates, OUT/report")
    run.add_argument("study", metavar="STUDY", help=_STUDY_HELP)
    run.add_argument("out", metavar="OUT", help="folder to write to")
    rendering(run)

    calibrate = verb("calibrate", "calibrate a camera from a group of rendered chessboards, with OpenCV")
    calibrate.add_argument("dataset", metavar="DATASET")
    calibrate.add_argument("camera", metavar="CAMERA", help="where the camera file is written")
    calibrate.add_argument("--group", metavar="GROUP", help="the chessboards (default: the only such group)")
    calibrate.add_argument("--views", type=_views, metavar="N", help="only the first N views (default: all)")

    verify = verb("verify", "check the integrity of a dataset and print its fidelity; writes nothing")
    verify.add_argument("dataset", metavar="DATASET")
    verify.add_argument("--full", action="store_true", help="also compute every checksum and decode every image")

    marker = verb("marker", "write a marker to print, to scale, with a ruler that checks the printer")
    marker.add_argument(
        "kind",
        metavar="KIND",
        help="disc, disc_with_tick, ring, rings, coded_rings, two_discs, dot_ring, disc_with_chessboard, chessboard, "
        "charuco, tags",
    )
    marker.add_argument("out", metavar="OUT", help="ends in .pdf or .svg")
    marker.add_argument("--diameter-m", type=_positive, metavar="D", help="of the circle (default 0.08)")
    marker.add_argument("--paper", default="a4", metavar="NAME", help="a5, a4 (default), a3, letter, legal, tabloid")
    marker.add_argument(
        "--set", action="append", metavar="KEY=VALUE", help="a key of the marker's section, as inner_diameter_m=0.05"
    )

    verb("doctor", "print versions and the renderer's backend, what is missing, and its remedy")
    return parser


def _run(arguments: argparse.Namespace) -> int:
    from roundel.cli import verbs

    action: Callable[[argparse.Namespace], int] = getattr(verbs, f"do_{arguments.verb}")
    return action(arguments)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; expected failures become one line on stderr and an exit code."""
    parser = build_parser()
    arguments = parser.parse_args(argv)
    if arguments.version:
        from importlib.metadata import version

        print(f"roundel {version('roundel')}")
        return 0
    if arguments.verb is None:
        parser.print_help()
        return 2
    from roundel.cli.interrupt import was_interrupted, watch

    for stream in (sys.stdout, sys.stderr):
        # A terminal that knows ASCII alone gets an escape for a degree sign, not an error.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    watch()
    try:
        code = _run(arguments)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return _interrupted(arguments.verb)
    except BrokenPipeError:
        _leave_stdout()
        return 0
    except Exception as error:
        from roundel.scenes.errors import RoundelError

        if os.environ.get("ROUNDEL_DEBUG"):
            raise
        if was_interrupted():
            return _interrupted(arguments.verb)
        if isinstance(error, RoundelError):
            print(f"roundel: {_one_line(error)}", file=sys.stderr)
            return error.exit_code
        if isinstance(error, MemoryError):
            print("roundel: out of memory; use fewer --jobs or smaller frames", file=sys.stderr)
        elif isinstance(error, OSError):
            print(f"roundel: {error.filename or ''}: {error.strerror or _one_line(error)}", file=sys.stderr)
        else:
            print(
                f"roundel: internal error: {type(error).__name__}: {_one_line(error)}; "
                "this is a bug, ROUNDEL_DEBUG=1 shows where",
                file=sys.stderr,
            )
        return 4


def _interrupted(verb: str) -> int:
    kept = verb in ("render", "develop", "run")
    print(
        "roundel: interrupted; " + ("frames that are rendered are kept" if kept else "its results are not written"),
        file=sys.stderr,
    )
    return 130


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


if __name__ == "__main__":
    sys.exit(main())
