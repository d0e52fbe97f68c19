"""Actions and options of ``ffsm campaign``."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from ffsm_mj.cli.exit_codes import BAD_INPUT, INTERRUPTED, OK, RUN_FAILED, exit_codes_with

_ACTIONS = {
    "run": "run a campaign, or continue the one in its folder, and print its results",
    "status": "print the progress of a campaign",
    "resume": "run what has no result yet",
    "extend": "enlarge a design of random or Sobol samples, and run the new samples",
    "report": "write tables, figures and a page for a campaign, and print a summary",
    "rerun": "repeat runs of a campaign, write their logs and compare them with the recorded results",
}
_EXECUTED = {
    OK: "every run has a result",
    BAD_INPUT: "bad input, changed settings, or already running elsewhere",
    RUN_FAILED: "stopped early (limits.max_failed, workers lost, full disk)",
    INTERRUPTED: "interrupted (results kept)",
}
EXIT_CODES = dict.fromkeys(("run", "resume", "extend"), _EXECUTED) | {
    "rerun": {RUN_FAILED: "a rerun differs from its result, or output was lost (full disk)"}
}
"""Meanings that are not general, by action."""


def describe_campaign(of: argparse.ArgumentParser, add_overrides: Callable[[argparse.ArgumentParser], None]) -> None:
    """Add the actions and their options to a parser."""
    actions = of.add_subparsers(title="actions", metavar="ACTION", dest="action", required=True)
    parsers = {
        name: actions.add_parser(
            name, help=text, description=f"{text[0].upper()}{text[1:]}.", epilog=exit_codes_with(EXIT_CODES.get(name, {}))
        )
        for name, text in _ACTIONS.items()
    }
    run = parsers["run"]
    run.add_argument("campaign", nargs="?", help="a campaign file, or the name of a shipped one (see --list)")
    run.add_argument("--list", action="store_true", help="list the shipped campaigns and exit")
    run.add_argument("--out", metavar="DIR", help="campaign folder (default: logs/campaign-<name>)")
    add_overrides(run)
    for name in ("status", "resume", "extend", "report", "rerun"):
        parsers[name].add_argument("folder", metavar="DIR", help="campaign folder")
    parsers["extend"].add_argument("n", type=_whole, help="new total number of samples; a power of 2 for a Sobol design")
    parsers["rerun"].add_argument("index", type=_whole, nargs="+", help="indices of the runs, from 0")
    parsers["report"].add_argument(
        "--page",
        metavar="FILE",
        help="Markdown file; figures go to figures/ beside it (default: report.md in DIR, beside report.html)",
    )
    parsers["rerun"].add_argument("--variant", metavar="NAME", default="", help="variant of the runs")
    parsers["resume"].add_argument(
        "--retry",
        type=_outcomes,
        default=(),
        metavar="OUTCOMES",
        help="also repeat runs with these outcomes: error, crashed, timeout; separate several by commas",
    )
    for name in ("run", "resume", "extend", "rerun"):
        parsers[name].add_argument(
            "--metrics", metavar="FILE", help="Python file, which is executed: each of its functions of a run is a metric"
        )
    for name in ("run", "resume", "extend"):
        _add_engine(parsers[name])


def _add_engine(to: argparse.ArgumentParser) -> None:
    """Add the options of where runs are executed."""
    where = to.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=_positive, metavar="N", help="number of worker processes (default: one per processor)"
    )
    where.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="address of a Dask scheduler, e.g. tcp://host:8786; local: a cluster on this machine, one worker per processor",
    )


def _whole(text: str) -> int:
    """An integer, not negative.

    Raises:
        ArgumentTypeError: The text is none.
    """
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is not an integer")
    return int(text)


def _positive(text: str) -> int:
    if _whole(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return int(text)


def _outcomes(text: str) -> tuple[str, ...]:
    from ffsm_mj.experiments.store import RETRIED  # slow to import

    names = tuple(text.split(","))
    for name in names:
        if name not in RETRIED:
            raise argparse.ArgumentTypeError(f"{name!r} is not one of {', '.join(RETRIED)}")
    return names
