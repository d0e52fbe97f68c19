"""Implementation of ``ffsm new`` and ``ffsm new-law``: generate starting files."""

from __future__ import annotations

import argparse
from pathlib import Path

from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.progress import progress
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.errors import working_on


def new(options: argparse.Namespace, output: Output) -> int:
    """Generate a scenario and a scene model from a robot model; returns the exit code.

    Raises:
        InputError: The model cannot be used, or a file exists.
    """
    from ffsm_mj.templates.robot import TemplateRequest, write_scenario

    packages = tuple(map(Path, options.package_path))
    with progress() as shown, working_on(options.robot):
        shown.stage(f"compile {options.robot}")
        lines = write_scenario(
            TemplateRequest(
                name=options.name,
                robot=Path(options.robot),
                out=Path(options.out),
                base=options.base is None,
                base_mass=options.base_mass,
                root=options.root,
                tip=options.tip,
                packages=packages,
            )
        )
    for line in lines:
        output.say(line)
    return OK


def new_law(options: argparse.Namespace, output: Output) -> int:
    """Generate a Python package with a control law; returns the exit code.

    Raises:
        InputError: The name is invalid, or a file exists.
    """
    from ffsm_mj.scenario.loading import controller_kinds
    from ffsm_mj.templates.law import next_commands, write_law

    written = write_law(options.name, Path(options.out), controller_kinds())
    home = Path(options.out) / options.name
    output.say(f"files in {home}: {', '.join(written)}")
    output.say("next:")
    for line in next_commands(home, options.name):
        output.say(f"  {line}")
    return OK
