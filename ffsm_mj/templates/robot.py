"""A scenario to start from for a robot's file: the robot on a base of its own, and a ball that meets its tip."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
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
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.driven_joints import driven_joints
from ffsm_mj.model.files import ModelFiles, menagerie_file, read_model
from ffsm_mj.model.system import System
from ffsm_mj.templates.pose import (
    Tip,
    felt_mass,
    find_approach,
    find_tip,
    hand_geoms,
    posed,
    solid_geoms,
    starting_pose,
)
from ffsm_mj.templates.robot_text import Approach, Base, Places, Start, ball_text, model_text, rounded, scenario_text
from ffsm_mj.templates.vendor import Decomposable, decomposable, needed_strips, read_vendor

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
class RobotRequest:
    """What a scenario is asked for, of a robot.

    Attributes:
        name: Of the scenario and its files.
        robot: The robot's file.
        out: Folder to write to.
        base_mass: Of the base, a spacecraft's wheels included, kg; None: five times the robot's, or 500 kg of a spacecraft.
        base_size: Its edges in m, (3,), or one for all, (1,); empty: those of a cube of a satellite's density.
        root: Body that the robot is with all below it; empty: the only one that moves.
        tip: Name of a site or body of the robot; empty: to be found.
        packages: Folders of the packages that a URDF names.
    """

    name: str
    robot: Path
    out: Path
    base_mass: float | None
    base_size: tuple[float, ...]
    root: str
    tip: str
    packages: tuple[Path, ...]


def write_scenario(asked: RobotRequest, *, on_base: bool, decompose: str) -> list[str]:
    """Write a scenario, its robot and its ball; nothing is left of them where they would not do.

    Args:
        asked: The robot.
        on_base: Whether a robot that does not float is mounted on a base; else the root of a URDF floats.
        decompose: Method for meshes that are not convex; empty: they stay their hulls.

    Returns:
        Lines that tell what was written, and what of it was chosen.

    Raises:
        InputError: A name that cannot be, is that of a file that stands there, or a robot that cannot be taken.
    """
    name, (scenario, model, ball) = new_files(asked.name, asked.out, "_ball.xml")
    vendor = read_vendor(asked.robot, asked.packages, asked.root)
    of_base = "mass" if asked.base_mass is not None else "size" if asked.base_size else ""
    if vendor.floats and (of_base or not on_base):
        option = f"--base-{of_base}" if on_base else "--base"
        raise InputError(f"new: {option}: {asked.robot} floats already, no base is added; leave it out")
    if not on_base and (of_base or not vendor.urdf):
        wrong = (
            f"has no {of_base}; leave --base-{of_base} out"
            if vendor.urdf
            else "is for a URDF; give the root of an MJCF a <freejoint/>"
        )
        raise InputError(f"new: --base none {wrong}")
    mounted = on_base and not vendor.floats
    base = cuboid(asked.base_mass or rounded(_BASE_PER_ROBOT * vendor.mass, 1), asked.base_size) if mounted else None
    asked.out.mkdir(parents=True, exist_ok=True)
    with removed_after(asked.robot, scenario, model, ball):
        robot = model if on_base else asked.robot  # the root of a URDF gets a free joint wherever it is read
        if on_base:
            model.write_text(model_text(name, vendor, base, relative(asked.robot, asked.out)), encoding="utf-8")
        folders = outside(vendor.folder, asked.out) if on_base else []
        files = read_model(robot, folders, asked.packages)
        files = replace(files, strip=tuple(needed_strips(files)))
        decomposed = Decomposable((), ())
        if decompose:
            alone = compile_system(files, {}, time_step_s=TIME_STEP_S)
            decomposed = decomposable(files, alone, "robot", decompose, robot.parent)
        start = _start(files, ball, asked.tip)
        places = placed(asked.out, robot, folders, asked.packages)
        scenario.write_text(
            scenario_text(name, asked.robot.name, files.strip, decomposed.data, start, places), encoding="utf-8"
        )
        prepare(scenario)
    written = [path.name for path in (scenario, model, ball) if path.exists()]
    unmounted = (
        "the root of the robot floats; --base-mass KG mounts it on a base instead"
        if not on_base
        else ("none is added, the robot floats already")
    )
    return [
        f"files in {asked.out}: {', '.join(written)}",
        f"base: {base.description}" if base else f"base: {unmounted}",
        *(["a URDF that is a spacecraft itself floats on its own root with --base none"] if base and vendor.urdf else []),
        f"tip: {start.description}",
        *([f"no ball: {start.without_ball}"] if start.without_ball else []),
        *([f"removed from the robot: {', '.join(files.strip)}"] if files.strip else []),
        *(f"mesh {line}" for line in decomposed.lines),
        f"next: {command('check', scenario)} && {command('run', scenario)}",
    ]


def copied(name: str, out: Path) -> Path:
    """Copy the files of a robot of MuJoCo Menagerie into a folder of its name; returns the main one.

    Raises:
        InputError: There is no such robot, or the folder exists.
    """
    file = menagerie_file(name)
    folder = out / name.partition("/")[0]
    if os.path.lexists(folder):
        raise InputError(
            f"new: {folder} exists; nothing is written over it; --robot {folder / file.name} uses what is there"
        )
    files = read_model(file)
    licences = {path.name: path.read_bytes() for path in file.parent.glob("LICENSE*") if path.is_file()}
    for part, content in {**files.files, **licences}.items():
        (folder / part).parent.mkdir(parents=True, exist_ok=True)
        (folder / part).write_bytes(content)
    return folder / files.main


def new_files(name: str, out: Path, *ends: str) -> tuple[str, list[Path]]:
    """Name of a scenario without its ending, and paths of its files: the scenario, its model, and others by their ends.

    Raises:
        InputError: A name that cannot be, or is that of a file that stands there.
    """
    name = re.sub(r"\.ya?ml$", "", name)
    if not _NAME.fullmatch(name):
        raise InputError(
            f"new: {name!r} is no name of a scenario: letters, digits, '.', '_' and '-'; --out names its folder"
        )
    paths = [out / f"{name}{end}" for end in (".yaml", ".xml", *ends)]
    for path in paths:
        if os.path.lexists(path):  # a link that leads nowhere is written through, too
            raise InputError(f"new: {path} exists; nothing is written over it")
    return name, paths


def cuboid(mass: float, edges: tuple[float, ...] = ()) -> Base:
    """A base of some mass, kg: of the given edges, m, or one for all; without any a cube of a satellite's density."""
    half = rounded(math.cbrt(mass / _BASE_DENSITY) / 2, 2)
    x, y, z = (edge / 2 for edge in edges * (3 // len(edges))) if edges else (half, half, half)
    return Base(mass, (x, y, z))


def relative(path: Path, folder: Path) -> str:
    """A path as a file in a folder has it."""
    return Path(os.path.relpath(path, folder)).as_posix()


def placed(out: Path, model: Path, folders: Iterable[Path], packages: Iterable[Path]) -> Places:
    """Paths as a scenario in a folder has them."""
    return Places(relative(model, out), *([relative(one, out) for one in some] for some in (folders, packages)))


def outside(folder: Path, out: Path) -> list[Path]:
    """A folder that a scenario in another one has to name to read files from it; empty if it is in that one."""
    home = Path(os.path.abspath(folder))
    return [] if home.is_relative_to(os.path.abspath(out)) else [home]


@contextmanager
def removed_after(robot: Path, *paths: Path) -> Iterator[None]:
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
    if start is None:
        return line
    text = re.sub(r"^(\d+:)*\s*", "", line[len(start) + 1 :])  # a place in a file that nobody can look at
    pose = "; the pose is that of its first keyframe, if it has one" if text.startswith("initial.joints.") else ""
    return f"{robot}: as {starts[start].name}, which is not written: {text}{pose}"


def _start(files: ModelFiles, ball: Path, wanted: str) -> Start:
    """Compile the robot, then robot and ball, by the conservative rules of a run, and work out how they meet."""
    system = compile_system(files, {}, time_step_s=TIME_STEP_S)
    pose = starting_pose(system)
    tip = find_tip(system, posed(system, pose), wanted)
    if solid_geoms(system):
        start = _with_ball(files, system, ball, pose, tip)
        if start.approach is not None:
            return start
        ball.unlink()
        why = "no straight line was found on which a ball meets the tip before other parts (--tip names another)"
    else:
        why = "no geom of the robot can touch a ball (contype and conaffinity)"
    return _stated(system, posed(system, pose), pose, tip, None, why)


def _with_ball(files: ModelFiles, alone: System, ball: Path, pose: dict[str, float], tip: Tip) -> Start:
    """The start with a ball that meets the tip, whose file is written; without an approach if none is found."""
    data = posed(alone, pose)
    centre = data.subtree_com[alone.robot.root]
    extent = max(np.linalg.norm(x - centre) + r for x, r in zip(data.geom_xpos, alone.mj.geom_rbound, strict=True))
    radius = rounded(0.06 * float(extent), 1)
    ball.write_text(ball_text(radius, 1.0), encoding="utf-8")
    system = compile_system(files, {"ball": read_model(ball)}, time_step_s=TIME_STEP_S)
    data = posed(system, pose)
    place = data.xpos[tip.body] + data.xmat[tip.body].reshape(3, 3) @ tip.local
    hand = next(hand_geoms(system, tip), [])
    pairs = [ContactPair(system, str(g), system.mj.geom(g).name, "ball/ball", 1.0) for g in solid_geoms(system)]
    met = find_approach(system, data, place, hand, pairs) if hand else None
    data = posed(system, pose)
    approach = None
    if met is not None:
        ball.write_text(ball_text(radius, rounded(_BALL_PER_FELT * felt_mass(system, data, met), 1)), encoding="utf-8")
        speed = rounded(2.0 * radius, 1)
        approach = Approach(digits(met.touch + speed * met.outwards, 6), digits(-speed * met.outwards, 6))
    return _stated(system, data, pose, tip, approach, "")


def _gains(system: System, data: Any) -> tuple[list[float], list[float]]:
    """Gains of a PD law on every driven joint: critical damping of the inertia that it moves, far from unstable."""
    try:
        dofs = driven_joints(system, None).dofs
    except ScenarioFaults:
        return [], []  # servos drive joints, or nothing does, as of a body with thrusters alone
    mobility = np.linalg.solve(mass_matrix(system.mj, data), np.eye(system.mj.nv)[:, dofs])[dofs]
    inertia = np.diag(np.linalg.inv(mobility))
    fastest = float(np.max(np.linalg.eigvals(CONTROL_PERIOD_S * mobility * (2.0 * inertia)).real))
    frequency = min(_FREQUENCY, _MOST_DAMPED / fastest)
    return [rounded(frequency**2 * x, 2) for x in inertia], [rounded(2.0 * frequency * x, 2) for x in inertia]


def _stated(system: System, data: Any, pose: dict[str, float], tip: Tip, approach: Approach | None, why: str) -> Start:
    model = system.mj
    body = model.body(tip.body).name.split("/", 1)[1]
    sites = {model.site(s).name.split("/", 1)[1] for s in range(model.nsite)}
    site = tip.site or next(name for name in ("tip", "new_tip", *(f"tip_{i}" for i in range(2, 99))) if name not in sites)
    place = data.xpos[tip.body] + data.xmat[tip.body].reshape(3, 3) @ tip.local
    kp, kd = _gains(system, data)
    return Start(
        pose=pose,
        tip=site,
        on=None if tip.site else (body, digits(tip.local, 4)),
        target=digits(place, 4),
        approach=approach,
        without_ball=why,
        kp=kp,
        kd=kd,
        servos=bool(servo_mask(model).any()),
    )


def digits(vector: FloatArray, places: int) -> list[float]:
    """Numbers to some decimal places."""
    return [round(float(x), places) + 0.0 for x in vector]
