"""The argument parser's class: a wrong argument gives one line on stderr, with a suggestion."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from roundel.scenes.errors import did_you_mean

_USAGE_STATUS = 2


class Parser(argparse.ArgumentParser):
    """An ArgumentParser that suggests a verb or option for a mistyped one."""

    _given: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as argparse does, but report unknown arguments here.

        argparse passes them to the parser of the whole command, which does not know the verb's options.
        """
        self._given = list(sys.argv[1:] if args is None else args)
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unexpected argument {unknown[0]!r}")
        return parsed, unknown

    def error(self, message: str) -> NoReturn:
        """Print one line on stderr and exit with status 2."""
        # An unknown option takes precedence: argparse would only report the missing required option.
        text = next(filter(None, map(self._unknown_option, self._own_words())), message)
        where = "" if text.endswith("?") else f"; see `{self.prog} --help`"
        self.exit(_USAGE_STATUS, f"{self.prog}: {text}{where}\n")

    def _own_words(self) -> Sequence[str]:
        """The words that this parser reads; for the whole command, those before the verb."""
        words = list(self._given)
        ends = (i for i, word in enumerate(words) if word == "--" or (self._subparsers and not word.startswith("-")))
        return words[: next(ends, len(words))]

    def _unknown_option(self, word: str) -> str | None:
        name = word.partition("=")[0]
        known = self._option_string_actions
        # A negative number is a value, and argparse accepts abbreviations.
        if not name.startswith("-") or not name.strip("-")[:1].isalpha() or any(o.startswith(name) for o in known):
            return None
        return f"unknown option {name}" + _suggestion(f"--{name.lstrip('-')}", known)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        what = action.metavar or action.dest
        if isinstance(action, argparse._SubParsersAction):
            what = str(what).lower()
        hint = _suggestion(str(value), action.choices) or f"; use one of {', '.join(action.choices)}"
        raise argparse.ArgumentError(None, f"unknown {what} {value!r}{hint}")


def _suggestion(word: str, known: Iterable[str]) -> str:
    hint = did_you_mean(word, known)
    return f"; {hint}" if hint else ""
