"""What ``ffsm campaign`` takes, as words."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from ffsm_mj.campaign.storage.outcomes import RETRIED
from ffsm_mj.cli.exit_codes import BAD_INPUT, INTERRUPTED, OK, RUN_FAILED

_ACTIONS = {
    "run": "begin a campaign, or go on with the one that its folder holds",
    "status": "say how far a campaign is",
    "resume": "make the runs that have no row yet",
    "extend": "add runs to a design of random or sobol samples, and make them",
    "report": "write tables, figures and a page about a campaign",
    "rerun": "make a run of the table again, with its log, and compare it with its row",
}
_EXIT_CODES = (
    f"exit codes: {OK} every run has its row; {BAD_INPUT} bad input, other settings, or another process runs it; "
    f"{RUN_FAILED} stopped before (limits.max_failed, workers lost, full disk), or a rerun is not its row's; "
    f"{INTERRUPTED} interrupted (all rows kept)"
)


def describe_campaign(of: argparse.ArgumentParser, add_overrides: Callable[[argparse.ArgumentParser], None]) -> None:
    """Add the actions and their options."""
    actions = of.add_subparsers(title="actions", metavar="ACTION", dest="action", required=True)
    parsers = {
        name: actions.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.", epilog=_EXIT_CODES)
        for name, text in _ACTIONS.items()
    }
    run = parsers["run"]
    run.add_argument("campaign", nargs="?", help="a campaign file, or the name of a shipped one (see --list)")
    run.add_argument("--list", action="store_true", help="list the shipped campaigns and exit")
    run.add_argument("--out", metavar="DIR", help="its folder (default: logs/campaign-<name>)")
    add_overrides(run)
    for name in ("status", "resume", "extend", "report", "rerun"):
        parsers[name].add_argument("folder", metavar="DIR", help="folder of the campaign")
    parsers["extend"].add_argument("n", type=_whole, help="size of the sample then; of sobol a power of 2")
    parsers["rerun"].add_argument("index", type=_whole, nargs="+", help="numbers of the runs, from 0")
    parsers["report"].add_argument(
        "--page", metavar="FILE", help="Markdown file, pictures in figures/ beside it (default: report.md in DIR)"
    )
    parsers["resume"].add_argument(
        "--retry",
        type=_outcomes,
        default=(),
        metavar="OUTCOMES",
        help=f"make runs with these outcomes again: {', '.join(RETRIED)}, several joined by commas",
    )
    for name in ("run", "resume", "extend"):
        where = parsers[name].add_mutually_exclusive_group()
        where.add_argument("--workers", type=_positive, metavar="N", help="processes (default: one per processor)")
        where.add_argument("--dask", metavar="ADDRESS", help="scheduler of a dask cluster, e.g. tcp://host:8786")


def _whole(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is no whole number")
    return int(text)


def _positive(text: str) -> int:
    if _whole(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return int(text)


def _outcomes(text: str) -> tuple[str, ...]:
    names = tuple(text.split(","))
    for name in names:
        if name not in RETRIED:
            raise argparse.ArgumentTypeError(f"{name!r} is none of {', '.join(RETRIED)}")
    return names
