"""The `roundel` command: arguments in, exit status out. Each verb imports the packages that it needs."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Callable, Sequence

from roundel.cli.arguments import leave_stdout
from roundel.cli.parser import build_parser


def _run(arguments: argparse.Namespace) -> int:
    from roundel.cli.verbs import chain, datasets, exports, reports

    name = f"do_{arguments.verb}"
    found = next(module for module in (datasets, exports, reports, chain) if hasattr(module, name))
    action: Callable[[argparse.Namespace], int] = getattr(found, name)
    return action(arguments)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; expected failures become one line on stderr and an exit status."""
    parser = build_parser()
    if "_ARGCOMPLETE" in os.environ:
        from roundel.cli.completion import complete

        complete(parser)
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
        # An ASCII-only terminal gets an escape sequence for a degree sign instead of an error.
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
        leave_stdout()
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
                "this is a bug; set ROUNDEL_DEBUG=1 for a traceback",
                file=sys.stderr,
            )
        return 4


_AFTER_INTERRUPT = {
    **dict.fromkeys(("render", "develop", "run", "league"), "; rendered frames are kept"),
    "solve": "; run the same command again",
    **dict.fromkeys(("validate", "calibrate", "compare", "browse", "import"), "; no results are written"),
    **dict.fromkeys(("export", "card"), "; nothing is written"),
}


def _interrupted(verb: str) -> int:
    print(f"roundel: interrupted{_AFTER_INTERRUPT.get(verb, '')}", file=sys.stderr)
    return 130


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


if __name__ == "__main__":
    sys.exit(main())
