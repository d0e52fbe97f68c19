"""A scenario to start from for a robot's file: the robot on a base of its own, and a ball that meets its tip."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import InputError, ScenarioFaults, one_line
from ffsm_mj.invocation import command
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.driven_joints import driven_joints
from ffsm_mj.model.files import ModelFiles, read_model
from ffsm_mj.model.system import System
from ffsm_mj.templates.pose import (
    Encounter,
    Tip,
    felt_mass,
    find_encounter,
    find_tip,
    hand_geoms,
    posed,
    solid_geoms,
    starting_pose,
)
from ffsm_mj.templates.robot_text import Base, Hit, ball_text, model_text, rounded, scenario_text
from ffsm_mj.templates.vendor import needed_strips, read_vendor

TIME_STEP_S, CONTROL_PERIOD_S = 0.001, 0.005
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_BASE_PER_ROBOT = 5.0
"""Mass of the base, by that of the robot on it."""
_BALL_PER_FELT = 0.3
"""Mass of the ball, by that which it meets: it flies back."""
_BASE_DENSITY = 250.0  # kg/m^3, a satellite's
_FREQUENCY = 3.0  # rad/s, with which a joint swings back
_MOST_DAMPED = 0.5  # of an eigenvalue of dt M_c^-1 K_d, which is stable up to 2


@dataclass(frozen=True)
class TemplateRequest:
    """What a scenario is asked for.

    Attributes:
        name: Of the scenario and its files.
        robot: The robot's file.
        out: Folder to write to.
        base_mass: kg; None: five times the robot's.
        root: Body that the robot is with all below it; empty: the only one that moves.
        tip: Name of a site or body of the robot; empty: to be found.
        packages: Folders of the packages that a URDF names.
    """

    name: str
    robot: Path
    out: Path
    base_mass: float | None = None
    root: str = ""
    tip: str = ""
    packages: tuple[Path, ...] = ()


def write_scenario(asked: TemplateRequest) -> list[str]:
    """Write a scenario, its robot and its ball; nothing is left of them where they would not do.

    Returns:
        Lines that tell what was written, and what of it was chosen.

    Raises:
        InputError: A name that cannot be, is that of a file that stands there, or a robot that cannot be taken.
    """
    name = re.sub(r"\.ya?ml$", "", asked.name)
    if not _NAME.fullmatch(name):
        raise InputError(
            f"new: {name!r} is no name of a scenario: letters, digits, '.', '_' and '-'; --out names its folder"
        )
    scenario, model, ball = (asked.out / f"{name}{end}" for end in (".yaml", ".xml", "_ball.xml"))
    for path in (scenario, model, ball):
        if os.path.lexists(path):  # a link that leads nowhere is written through, too
            raise InputError(f"new: {path} exists; nothing is written over it")
    vendor = read_vendor(asked.robot, asked.packages, asked.root)
    if vendor.floats and asked.base_mass is not None:
        raise InputError(f"new: --base-mass: {asked.robot} floats already, no base is added; leave it out")
    base = None if vendor.floats else _base(asked.base_mass or rounded(_BASE_PER_ROBOT * vendor.mass, 1))
    asked.out.mkdir(parents=True, exist_ok=True)
    with _taken_back(asked.robot, scenario, model, ball):
        model.write_text(model_text(name, vendor, base, _relative(asked.robot, asked.out)), encoding="utf-8")
        folders = [] if vendor.folder.is_relative_to(os.path.abspath(asked.out)) else [vendor.folder]
        files = read_model(model, folders, asked.packages)
        files = replace(files, strip=tuple(needed_strips(files)))
        hit = _hit(files, ball, asked.tip)
        places = [_relative(folder, asked.out) for folder in folders], [_relative(p, asked.out) for p in asked.packages]
        scenario.write_text(scenario_text(name, asked.robot.name, files.strip, hit, places), encoding="utf-8")
        prepare(scenario)
    return [
        f"files in {asked.out}: {scenario.name}, {model.name}, {ball.name}",
        f"base: {base.description}" if base else "base: none is added, the robot floats already",
        f"tip: {hit.description}",
        f"removed from the robot: {', '.join(files.strip) or 'nothing'}",
        f"next: {command('check', scenario)} && {command('run', scenario)}",
    ]


def _base(mass: float) -> Base:
    return Base(mass, rounded(math.cbrt(mass / _BASE_DENSITY) / 2, 2))


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path, folder)).as_posix()


@contextmanager
def _taken_back(robot: Path, *paths: Path) -> Iterator[None]:
    """Files that are gone again where something is wrong with them; what is wrong with them is wrong with the robot.

    Raises:
        InputError: Names the robot's file wherever one of these was named.
    """
    try:
        yield
    except BaseException as error:
        for path in paths:
            path.unlink(missing_ok=True)
        if isinstance(error, InputError):
            starts = {one_line(str(path)): path for path in paths}
            raise InputError([_of_robot(line, robot, starts) for line in error.lines]) from error
        raise


def _of_robot(line: str, robot: Path, starts: Mapping[str, Path]) -> str:
    """A line about a file that is gone again, as one about the robot's file."""
    start = next((start for start in starts if line.startswith(f"{start}:")), None)
    return line if start is None else f"{robot}: as {starts[start].name}: {line[len(start) + 1 :].lstrip()}"


def _hit(files: ModelFiles, ball: Path, wanted: str) -> Hit:
    """Compile the robot, then robot and ball, by the conservative rules of a run, and work out how they meet."""
    system = compile_system(files, {}, time_step_s=TIME_STEP_S)
    if not solid_geoms(system):
        raise InputError(f"{files.place}: the robot has no geom that a ball could touch")
    pose = starting_pose(system)
    data = posed(system, pose)
    centre = data.subtree_com[system.robot.root]
    extent = max(np.linalg.norm(x - centre) + r for x, r in zip(data.geom_xpos, system.mj.geom_rbound, strict=True))
    radius = rounded(0.06 * float(extent), 1)
    ball.write_text(ball_text(radius, 1.0), encoding="utf-8")
    system = compile_system(files, {"ball": read_model(ball)}, time_step_s=TIME_STEP_S)
    data = posed(system, pose)
    tip = find_tip(system, data, wanted)
    place = data.xpos[tip.body] + data.xmat[tip.body].reshape(3, 3) @ tip.local
    hand, *before = hand_geoms(system, tip)
    base = [g for g in solid_geoms(system) if system.mj.geom_bodyid[g] == system.robot.root]
    geoms = sorted({*(before[0] if before else hand), *base})  # a ball that bounces may come to these
    pairs = [ContactPair(system, str(g), system.mj.geom(g).name, "ball/ball", 1.0) for g in solid_geoms(system)]
    met = find_encounter(system, data, place, hand, pairs)
    data = posed(system, pose)
    ball.write_text(ball_text(radius, rounded(_BALL_PER_FELT * felt_mass(system, data, met), 1)), encoding="utf-8")
    kp, kd = _gains(system, data)
    return _scenario_hit(system, pose, tip, place, geoms, met, kp, kd)


def _gains(system: System, data: Any) -> tuple[list[float], list[float]]:
    """Gains of a PD law on every driven joint: critical damping of the inertia that it moves, far from unstable.

    Raises:
        InputError: No joint is driven.
    """
    try:
        dofs = driven_joints(system, None).dofs
    except ScenarioFaults as fault:
        raise InputError(f"{system.files['robot'].place}: {fault}") from fault
    mobility = np.linalg.solve(mass_matrix(system.mj, data), np.eye(system.mj.nv)[:, dofs])[dofs]
    inertia = np.diag(np.linalg.inv(mobility))
    fastest = float(np.max(np.linalg.eigvals(CONTROL_PERIOD_S * mobility * (2.0 * inertia)).real))
    frequency = min(_FREQUENCY, _MOST_DAMPED / fastest)
    return [rounded(frequency**2 * x, 2) for x in inertia], [rounded(2.0 * frequency * x, 2) for x in inertia]


def _scenario_hit(
    system: System,
    pose: dict[str, float],
    tip: Tip,
    place: FloatArray,
    geoms: Sequence[int],
    met: Encounter,
    kp: Any,
    kd: Any,
) -> Hit:
    model = system.mj
    body = model.body(tip.body).name.split("/", 1)[1]
    sites = {model.site(s).name.split("/", 1)[1] for s in range(model.nsite)}
    site = tip.site or next(name for name in ("tip", "new_tip", *(f"tip_{i}" for i in range(2, 99))) if name not in sites)
    speed = rounded(2.0 * float(model.geom_rbound[model.ngeom - 1]), 1)
    return Hit(
        pose=pose,
        tip=site,
        on=None if tip.site else (body, [round(float(x), 4) + 0.0 for x in tip.local]),
        target=[round(float(x), 4) + 0.0 for x in place],
        ball=[round(float(x), 6) + 0.0 for x in met.touch + speed * met.outwards],
        velocity=[round(float(x), 6) + 0.0 for x in -speed * met.outwards],
        geoms=[model.geom(g).name for g in geoms],
        kp=kp,
        kd=kd,
    )
