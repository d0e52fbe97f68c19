"""Actions and options of ``ffsm study``."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from ffsm_mj.cli.campaign_options import EXIT_CODES, add_engine, add_retry, whole
from ffsm_mj.cli.exit_codes import exit_codes_with

_ACTIONS = {
    "run": "run a study, or continue the one in its folder",
    "status": "print the progress of a study, and what its results show so far",
    "resume": "run what has no result yet",
    "report": "write tables, figures and a page for a study, and print what its results show",
    "rerun": "repeat runs of a variant, write their logs and compare them with the recorded results",
}


def describe_study(of: argparse.ArgumentParser, add_overrides: Callable[[argparse.ArgumentParser], None]) -> None:
    """Add the actions and their options to a parser."""
    actions = of.add_subparsers(title="actions", metavar="ACTION", dest="action", required=True)
    parsers = {
        name: actions.add_parser(
            name,
            help=text,
            description=f"{text[0].upper()}{text[1:]}.",
            epilog=exit_codes_with(EXIT_CODES.get(name, {})),
        )
        for name, text in _ACTIONS.items()
    }
    run = parsers["run"]
    run.add_argument("study", nargs="?", help="a study file, or the name of a shipped one (see --list)")
    run.add_argument("--list", action="store_true", help="list the shipped studies and exit")
    run.add_argument("--out", metavar="DIR", help="study folder (default: logs/study-<name>)")
    add_overrides(run)
    for name in ("status", "resume", "report", "rerun"):
        parsers[name].add_argument("folder", metavar="DIR", help="study folder")
    parsers["report"].add_argument(
        "--page",
        metavar="FILE",
        help="Markdown file; figures go to figures/ beside it (default: report.md in DIR, beside report.html)",
    )
    add_retry(parsers["resume"])
    parsers["rerun"].add_argument("variant", help="name of the variant")
    parsers["rerun"].add_argument("index", type=whole, nargs="+", help="indices of the runs, from 0")
    for name in ("run", "resume", "rerun"):
        parsers[name].add_argument(
            "--metrics", metavar="FILE", help="Python file, which is executed: each of its functions of a run is a metric"
        )
    for name in ("run", "resume"):
        add_engine(parsers[name])
