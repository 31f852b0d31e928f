"""The verbs that take reports: compare, league, gate, baseline."""

from __future__ import annotations

import argparse


def do_compare(arguments: argparse.Namespace) -> int:
    """Write one page over several reports."""
    from roundel.cli.verbs.gate import compare_reports

    return compare_reports(arguments)


def do_league(arguments: argparse.Namespace) -> int:
    """Run the league, score a submission, or hold a part back."""
    from roundel.cli.verbs import league

    actions = {
        "run": league.run_league,
        "score": league.score_submission,
        "hold-back": league.hold_back,
    }
    return actions[arguments.action](arguments)


def do_gate(arguments: argparse.Namespace) -> int:
    """Compare a report with a baseline."""
    from roundel.cli.verbs.gate import compare

    return compare(arguments)


def do_baseline(arguments: argparse.Namespace) -> int:
    """Accept a baseline, or print its history."""
    from roundel.cli.verbs.gate import accept_baseline, print_history

    return print_history(arguments) if arguments.action == "log" else accept_baseline(arguments)
