"""Wrong arguments give one line with a suggestion; every argument of every verb has a help text."""

import argparse

import pytest

from roundel.cli.main import main
from roundel.cli.parser import EXIT_STATUS, build_parser
from roundel.scenes.errors import DataError, NotComparableError, UsageError

PARSER = build_parser()
VERBS = next(a for a in PARSER._actions if isinstance(a, argparse._SubParsersAction)).choices

SUGGESTIONS = {
    "rendr": "roundel: unknown verb 'rendr'; did you mean render?",
    "chek demo": "roundel: unknown verb 'chek'; did you mean check?",
    "--verson": "roundel: unknown option --verson; did you mean --version?",
    "render x y --fraems 0:1": "roundel render: unknown option --fraems; did you mean --frames?",
    "render x y -frames 0:1": "roundel render: unknown option -frames; did you mean --frames?",
    "render --fraems=0:1": "roundel render: unknown option --fraems; did you mean --frames?",
    # Both are wrong; the required one is only missing because it is mistyped.
    "gate r --baselne b": "roundel gate: unknown option --baselne; did you mean --baseline?",
    "baseline acept r": "roundel baseline: unknown action 'acept'; did you mean accept?",
}
OTHERS = {
    "zzz": "roundel: unknown verb 'zzz'; use one of check, preview, studies,",
    "render x y --zzz": "roundel render: unknown option --zzz; see `roundel render --help`",
    "render x y z": "roundel render: unexpected argument 'z'; see `roundel render --help`",
    "render x": "roundel render: the following arguments are required: DATASET; see `roundel render --help`",
    "completion tcsh": "roundel completion: unknown SHELL 'tcsh'; use one of bash, zsh, fish; see",
    "render x y --jobs -1": "roundel render: argument --jobs: '-1': give a whole number, 1 or more; see",
}


def refusal(words: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stop:
        main(words.split())
    assert stop.value.code == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err


@pytest.mark.parametrize("words", SUGGESTIONS)
def test_a_mistyped_word_gets_a_suggestion(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert refusal(words, capsys) == SUGGESTIONS[words] + "\n"


@pytest.mark.parametrize("words", OTHERS)
def test_a_wrong_argument_is_one_line(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    err = refusal(words, capsys)
    assert err.startswith(OTHERS[words])
    assert err.count("\n") == 1


def test_an_abbreviation_still_means_its_option() -> None:
    assert PARSER.parse_args(["render", "x", "y", "--fra", "0:2"]).frames == range(2)


@pytest.mark.parametrize("verb", VERBS)
def test_every_argument_has_help(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    actions = VERBS[verb]._actions
    assert [action.dest for action in actions if not action.help] == []
    with pytest.raises(SystemExit) as stop:
        main([verb, "--help"])
    assert stop.value.code == 0
    shown = capsys.readouterr().out
    assert all(str(action.metavar) in shown for action in actions if action.metavar)
    assert " ".join(EXIT_STATUS.split()) in " ".join(shown.split())


def test_help_states_the_exit_status_of_each_error() -> None:
    assert f"{UsageError.exit_code} usage" in EXIT_STATUS
    assert f"{NotComparableError.exit_code} not comparable" in EXIT_STATUS
    assert f"{DataError.exit_code} run-time failure or corrupt data" in EXIT_STATUS
