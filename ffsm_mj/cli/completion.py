"""Implementation of ``ffsm completion``: completion scripts, and the keys that they offer after ``-s``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

import shtab

from ffsm_mj.cli.command_line import parser
from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.file import campaign_names
from ffsm_mj.scenario.shipped import scenario_names, scenario_path

_PLACES = ("--out", "--save", "--plots", "--robot", "--package-path")
_TABLES = ("samples", "checks", "contacts", "grasps")
"""Tables besides those of records."""
# shtab treats the output of a function with "file" in its name as file names, so bash appends a slash to folders.
_FUNCTIONS = {
    "bash": """
{name}() {{
  compgen -W "{words}" -- "$1"{files}
}}""",
    "zsh": """
{name}() {{
  _alternative 'shipped:shipped:({words})'{files}
}}""",
    "fish": """
function {name}
  string split ' ' -- "{words}"{files}
end""",
}
_FILES = {
    "bash": '\n  compgen -f -- "$1"',
    "zsh": " 'files:file:_files'",
    "fish": "\n  __fish_complete_path (commandline -ct)",
}
_KEYS = {
    "bash": """
_ffsm_key() {
  compgen -W "$(ffsm completion --keys "${COMP_WORDS[@]:1}" 2>/dev/null)" -- "$1"
}""",
    "zsh": """
_ffsm_key() {
  compadd -S '=' -- ${(f)"$(ffsm completion --keys "${(@)words[2,-1]}" 2>/dev/null)"}
}""",
    "fish": """
function _ffsm_key
  set words (commandline -opc)
  ffsm completion --keys $words[2..-1] 2>/dev/null
end""",
}


def completion(options: argparse.Namespace, output: Output) -> int:
    """Print the completion script of a shell, or the keys of a scenario; returns the exit code.

    Raises:
        InputError: Neither is named.
    """
    if options.keys is not None:
        output.write("\n".join(_keys(options.keys)))
    elif options.shell is None:
        raise InputError("ffsm completion: name a shell: bash, zsh or fish")
    else:
        output.write(_script(options.shell))
    return OK


def _script(shell: str) -> str:
    """Completion script for ``bash``, ``zsh`` or ``fish``; it lists what the installed version ships."""
    from ffsm_mj.contact_models.registry import BUILT_IN_RECORDS

    whole = parser()
    for command, option in _options(whole):
        _set_completion(command, option)
    words = {
        "_ffsm_scenario_or_file": scenario_names(),
        "_ffsm_campaign_or_file": campaign_names(),
        "_ffsm_any_or_file": (*scenario_names(), *campaign_names()),
        "_ffsm_table": (*_TABLES, *(kind.plural for kind in BUILT_IN_RECORDS if kind.name != "outcome")),
    }
    preamble = _KEYS[shell]
    for name, some in words.items():
        files = _FILES[shell] if name.endswith("file") else ""
        preamble += _FUNCTIONS[shell].format(name=name, words=" ".join(some), files=files)
    return shtab.complete(whole, shell=shell, preamble=preamble).rstrip()


def _options(of: argparse.ArgumentParser, command: str = "") -> Iterator[tuple[str, argparse.Action]]:
    """Every option with its command."""
    for action in of._actions:  # argparse has no public access to them
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from _options(below, command or name)
        else:
            yield command, action


def _set_completion(command: str, option: argparse.Action) -> None:
    """Set what completes an option; other values cannot be completed."""
    if option.dest in ("scenario", "scene"):
        _complete_by(option, "_ffsm_any_or_file" if command == "check" else "_ffsm_scenario_or_file")
    elif option.dest == "campaign" and not option.option_strings:
        _complete_by(option, "_ffsm_campaign_or_file")
    elif option.dest == "overrides":
        _complete_by(option, "_ffsm_key")
    elif option.dest == "table":
        _complete_by(option, "_ffsm_table")
    elif option.dest in ("run", "runs", "data"):
        option.complete = shtab.FILE  # type: ignore[attr-defined]
    elif option.dest == "folder" or set(option.option_strings) & {*_PLACES, "--metrics"}:
        option.complete = shtab.FILE if option.metavar == "FILE" else shtab.DIRECTORY  # type: ignore[attr-defined]


def _complete_by(option: argparse.Action, function: str) -> None:
    option.complete = {"bash": function, "zsh": function, "fish": f"({function})"}  # type: ignore[attr-defined]


def _keys(words: Sequence[str]) -> list[str]:
    """Keys that ``-s`` can set, dotted: of the file that a command line names, else of any scenario."""
    from ffsm_mj.experiments.file import campaign_path, campaign_schema
    from ffsm_mj.scenario.faults import ANY, key_paths
    from ffsm_mj.scenario.scenario import ScenarioConfig
    from ffsm_mj.scenario.source import read_yaml
    from ffsm_mj.yaml import read_node

    for word in words[1:]:
        try:
            if words[0] == "campaign":
                data = read_node(campaign_path(word)).plain()
                return [".".join(path) for path in key_paths(campaign_schema(), data)]
            data = read_yaml(scenario_path(word)).data
            return [".".join(path) for path in key_paths(ScenarioConfig.model_json_schema(), data)]
        except (InputError, OSError):
            continue
    return [".".join(path) for path in key_paths(ScenarioConfig.model_json_schema()) if ANY not in path]
