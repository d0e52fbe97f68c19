"""Implementation of ``ffsm new`` and ``ffsm new-law``: generate starting files."""

from __future__ import annotations

import argparse
from pathlib import Path

from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.progress import Stage
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.errors import InputError, working_on


def new(options: argparse.Namespace, output: Output) -> int:
    """Generate a scenario and a scene model from a robot model; returns the exit code.

    Raises:
        InputError: The model cannot be used, or a file exists.
    """
    with output.progress() as stage:
        lines = (_new_scene if options.scene else _new_robot)(options, stage)
    for line in lines:
        if line.startswith("next: "):
            output.command(line.removeprefix("next: "), "next: ")
        else:
            output.say(line)
    return OK


def _new_scene(options: argparse.Namespace, stage: Stage) -> list[str]:
    """Generate a scenario for a scene in one file; returns what was written, as text."""
    from ffsm_mj.templates.scene import SceneRequest, write_scene

    if options.menagerie or not options.robot:
        raise InputError("new: --scene FILE needs --robot BODY, the root body of the robot in the file")
    if options.base or options.base_mass or options.root or options.tip or options.package_path:
        raise InputError("new: --scene FILE goes with --robot BODY, --decompose and --out alone")
    with working_on(options.scene):
        stage(f"compile {options.scene}")
        return write_scene(
            SceneRequest(options.name, Path(options.scene), options.robot, Path(options.out), options.decompose or "")
        )


def _new_robot(options: argparse.Namespace, stage: Stage) -> list[str]:
    """Generate a scenario around a robot's file; returns what was written, as text."""
    from ffsm_mj.templates.robot import TemplateRequest, copied, write_scenario

    if bool(options.robot) == bool(options.menagerie):
        raise InputError("new: give the robot by --robot FILE or by --menagerie NAME")
    robot, out = options.robot or options.menagerie, Path(options.out)
    with working_on(robot):
        stage(f"compile {robot}")
        file = copied(options.menagerie, out) if options.menagerie else Path(robot)
        return write_scenario(
            TemplateRequest(
                name=options.name,
                robot=file,
                out=out,
                base=options.base is None,
                base_mass=options.base_mass,
                root=options.root,
                tip=options.tip,
                packages=tuple(map(Path, options.package_path)),
                decompose=options.decompose or "",
            )
        )


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
        output.command(line, "  ")
    return OK
