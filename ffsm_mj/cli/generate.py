"""Implementation of ``ffsm new`` and ``ffsm new-law``: generate starting files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.progress import Stage
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.errors import InputError, working_on

if TYPE_CHECKING:
    from ffsm_mj.templates.robot import RobotRequest


def new(options: argparse.Namespace, output: Output) -> int:
    """Generate a scenario and a scene model from a robot model; returns the exit code.

    Raises:
        InputError: The model cannot be used, or a file exists.
    """
    with output.progress() as stage:
        others = _new_scene if options.scene else _new_spacecraft if _is_spacecraft(options) else _new_robot
        write = _new_start if options.state else others
        lines = write(options, stage)
    for line in lines:
        if line.startswith("next: "):
            output.command(line.removeprefix("next: "), "next: ")
        else:
            output.say(line)
    return OK


def _is_spacecraft(options: argparse.Namespace) -> bool:
    return options.wheels is not None or options.thrusters is not None


def _new_start(options: argparse.Namespace, stage: Stage) -> list[str]:
    """Generate a scenario that begins at a state of a log; returns what was written, as text."""
    from ffsm_mj.templates.logged_state import write_start

    stated = {key for key, value in vars(options).items() if value not in (None, False, "", [])}
    if others := sorted(stated - {"command", "name", "state", "out"}):
        raise InputError(f"new: --{others[0].replace('_', '-')} has no effect with --from RUN@TIME")
    folder, at_s = options.state
    stage(f"read {folder}")
    return write_start(options.name, Path(options.out), Path(folder), at_s)


def _new_scene(options: argparse.Namespace, stage: Stage) -> list[str]:
    """Generate a scenario for a scene in one file; returns what was written, as text."""
    from ffsm_mj.templates.scene import SceneRequest, write_scene

    if options.menagerie or not options.robot:
        raise InputError("new: --scene FILE needs --robot BODY, the root body of the robot in the file")
    of_base = options.base or options.base_mass or options.base_size
    if of_base or options.root or options.tip or options.package_path or _is_spacecraft(options):
        raise InputError("new: --scene FILE goes with --robot BODY, --decompose and --out alone")
    with working_on(options.scene):
        stage(f"compile {options.scene}")
        return write_scene(
            SceneRequest(options.name, Path(options.scene), options.robot, Path(options.out), options.decompose or "")
        )


def _new_robot(options: argparse.Namespace, stage: Stage) -> list[str]:
    """Generate a scenario around a robot's file; returns what was written, as text."""
    from ffsm_mj.templates.robot import write_scenario

    with _robot(options, stage) as asked:
        return write_scenario(asked, on_base=options.base is None, decompose=options.decompose or "")


def _new_spacecraft(options: argparse.Namespace, stage: Stage) -> list[str]:
    """Generate a spacecraft around an arm's file, and a mission; returns what was written, as text."""
    from ffsm_mj.templates.spacecraft import TargetRequest, write_spacecraft

    if options.base or options.decompose:
        raise InputError(
            f"new: {'--base none' if options.base else '--decompose'} has no effect with --wheels or --thrusters"
        )
    wheels = 4 if options.wheels is None else options.wheels
    thrusters = 12 if options.thrusters is None else options.thrusters
    target = Path(options.target) if options.target else None
    with _robot(options, stage) as asked:
        return write_spacecraft(asked, wheels, thrusters, TargetRequest(target, options.target_mass, options.grapple or ""))


@contextmanager
def _robot(options: argparse.Namespace, stage: Stage) -> Iterator[RobotRequest]:
    """What is asked of the robot, whose file is copied if it is one of MuJoCo Menagerie; errors of the file system name it.

    Raises:
        InputError: None is given, or two are.
    """
    from ffsm_mj.templates.robot import RobotRequest, copied

    if bool(options.robot) == bool(options.menagerie):
        raise InputError("new: give the robot by --robot FILE or by --menagerie NAME")
    robot = options.robot or options.menagerie
    with working_on(robot):
        stage(f"compile {robot}")
        yield RobotRequest(
            name=options.name,
            robot=copied(options.menagerie, Path(options.out)) if options.menagerie else Path(robot),
            out=Path(options.out),
            base_mass=options.base_mass,
            base_size=_edges(options.base_size),
            root=options.root,
            tip=options.tip,
            packages=tuple(map(Path, options.package_path)),
        )


def _edges(numbers: list[float] | None) -> tuple[float, ...]:
    """Edges of a base.

    Raises:
        InputError: Neither one nor three.
    """
    edges = tuple(numbers or ())
    if len(edges) not in (0, 1, 3):
        raise InputError(f"new: --base-size: {len(edges)} numbers; allowed: one edge for all, or three, x y z, m")
    return edges


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
