"""The script by which a shell completes ``ffsm``: commands and options from the parser, scenarios, files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import shtab

from ffsm_mj.cli.command_line import parser
from ffsm_mj.scenario.shipped import scenario_names

_PLACES = ("--out", "--plots", "--robot", "--package-path")
# shtab lets bash treat as file names what a function with "file" in its name offers: folders get their slash.
_SCENARIO = {"bash": "_ffsm_scenario_or_file", "zsh": "_ffsm_scenario_or_file", "fish": "(_ffsm_scenario_or_file)"}
_FUNCTIONS = {
    "bash": """
_ffsm_scenario_or_file() {{
  compgen -W "{names}" -- "$1"
  compgen -f -- "$1"
}}""",
    "zsh": """
_ffsm_scenario_or_file() {{
  _alternative 'scenarios:shipped scenario:({names})' 'files:file:_files'
}}""",
    "fish": """
function _ffsm_scenario_or_file
  string split ' ' -- "{names}"
  __fish_complete_path (commandline -ct)
end""",
}


def completion(shell: str) -> str:
    """A script for ``bash``, ``zsh`` or ``fish``; the scenarios in it are those that are shipped now."""
    whole = parser()
    for option in _options(whole):
        _say_what_it_takes(option)
    function = _FUNCTIONS[shell].format(names=" ".join(scenario_names()))
    return shtab.complete(whole, shell=shell, preamble=function).rstrip()


def _options(of: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in of._actions:  # argparse tells of them nowhere else
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _options(command)
        else:
            yield action


def _say_what_it_takes(option: argparse.Action) -> None:
    """Scenarios, runs and places to write are completed; other values are the user's own."""
    if option.dest == "scenario":
        option.complete = _SCENARIO  # type: ignore[attr-defined]
    elif option.dest in ("run", "runs"):
        option.complete = shtab.FILE  # type: ignore[attr-defined]
    elif set(option.option_strings) & set(_PLACES):
        option.complete = shtab.FILE if option.metavar == "FILE" else shtab.DIRECTORY  # type: ignore[attr-defined]
