"""Implementation of ``ffsm completion``: completion scripts of commands, options, shipped scenarios and files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import shtab

from ffsm_mj.cli.command_line import parser
from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.scenario.shipped import scenario_names

_PLACES = ("--out", "--plots", "--robot", "--package-path")
# shtab treats the output of a function with "file" in its name as file names, so bash appends a slash to folders.
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


def completion(options: argparse.Namespace, output: Output) -> int:
    """Print the completion script of a shell; returns the exit code."""
    output.say(_script(options.shell))
    return OK


def _script(shell: str) -> str:
    """Completion script for ``bash``, ``zsh`` or ``fish``; it lists the scenarios of the installed version."""
    whole = parser()
    for option in _options(whole):
        _set_completion(option)
    function = _FUNCTIONS[shell].format(names=" ".join(scenario_names()))
    return shtab.complete(whole, shell=shell, preamble=function).rstrip()


def _options(of: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in of._actions:  # argparse has no public access to them
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _options(command)
        else:
            yield action


def _set_completion(option: argparse.Action) -> None:
    """Complete scenarios, runs and output paths; other values cannot be completed."""
    if option.dest == "scenario":
        option.complete = _SCENARIO  # type: ignore[attr-defined]
    elif option.dest in ("run", "runs"):
        option.complete = shtab.FILE  # type: ignore[attr-defined]
    elif set(option.option_strings) & set(_PLACES):
        option.complete = shtab.FILE if option.metavar == "FILE" else shtab.DIRECTORY  # type: ignore[attr-defined]
