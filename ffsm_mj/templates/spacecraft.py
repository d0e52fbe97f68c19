"""A spacecraft of one's own: a vendor's arm on a bus with wheels and thrusters, and a mission that ends in a capture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.dynamics.rigid_body import mass_matrix, site_wrench
from ffsm_mj.dynamics.springs import JointSprings
from ffsm_mj.dynamics.stack_momentum import StackMomentum
from ffsm_mj.errors import InputError
from ffsm_mj.invocation import command
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.driven_joints import motors_of_joints
from ffsm_mj.model.files import ModelFiles, read_model
from ffsm_mj.model.source import unused
from ffsm_mj.model.system import System
from ffsm_mj.templates.layout import Authority, authority, jets, wheel_axes
from ffsm_mj.templates.mission import APPROACH_S, DURATION_S, STAND_OFF_S, Arm, GraspPlan, find_arm, plan_grasp
from ffsm_mj.templates.pose import find_tip, posed, starting_pose
from ffsm_mj.templates.robot import RobotRequest, cuboid, digits, new_files, outside, placed, relative, removed_after
from ffsm_mj.templates.robot_text import Places, rounded
from ffsm_mj.templates.spacecraft_text import Craft, Mission, mission_text, spacecraft_text, target_text
from ffsm_mj.templates.vendor import Vendor, needed_strips, read_vendor

_BUS_KG = 500.0
_TARGET_PER_BUS = 0.2
_TARGET_DENSITY = 250.0  # kg/m^3
_MESHES = (".stl", ".obj", ".msh")
_MODELS = (".xml", ".mjcf", ".urdf")
_TIME_STEP_S = 0.01
_CONTROL_PERIOD_S = 0.02
_WHEEL_PER_BUS = 0.01
_WHEEL_RAD_S = 600.0  # some 5700 rpm
_STORED_PER_KG, _TORQUE_PER_KG = 0.024, 0.004
"""Momentum in N m s and torque in N m of a wheel by the mass of the bus: 12 N m s and 2 N m for 500 kg."""
_FORCE_PER_KG = 0.004
"""Force of a thruster by the mass of the bus, N: 2 N for 500 kg."""
_MOST_DAMPED = 0.3  # of an eigenvalue of dt M_c^-1 K_d, which is stable up to 2
_MOST_DAMPING = 6.0  # N m s/rad
_FASTEST_DECAY = 0.5
"""Of a damper over a step; an accuracy of 1e-9 takes some 20 sub-steps for a decay by e."""


@dataclass(frozen=True)
class TargetRequest:
    """What is to be captured.

    Attributes:
        file: MJCF, URDF or mesh; None: a cuboid.
        mass: Of a cuboid or mesh, kg; None: a fifth of the bus.
        grapple: Site to grasp it at; empty: in front of a face.
    """

    file: Path | None
    mass: float | None
    grapple: str


def write_spacecraft(asked: RobotRequest, wheels: int, thrusters: int, captured: TargetRequest) -> list[str]:
    """Write a spacecraft, its target and the scenario of a capture; nothing is left of them where they would not do.

    Args:
        asked: The arm and the bus.
        wheels: Number of reaction wheels.
        thrusters: Number of thrusters.
        captured: What is captured.

    Returns:
        Lines that tell what was written, and what of it was chosen.

    Raises:
        InputError: An option that cannot be, a file that stands there or cannot be used, or a target out of reach.
    """
    name, (scenario, model, target_file) = new_files(asked.name, asked.out, "_target.xml")
    _refuse_target(captured)
    axes, layout = wheel_axes(wheels), jets(thrusters)
    vendor = read_vendor(asked.robot, asked.packages, asked.root)
    if vendor.floats:
        raise InputError(f"new: --robot: {asked.robot} floats already; --wheels and --thrusters are for an arm on a new bus")
    craft = _craft(asked, vendor, axes, layout)
    asked.out.mkdir(parents=True, exist_ok=True)
    with removed_after(asked.robot, scenario, model, target_file):
        model.write_text(spacecraft_text(name, vendor, craft, relative(asked.robot, asked.out)), encoding="utf-8")
        folders = outside(vendor.folder, asked.out)
        files = read_model(model, folders, asked.packages)
        files = replace(files, strip=tuple(needed_strips(files)))
        target, target_places = _target(asked, captured, target_file)
        system, data, arm = _compiled(files, target, asked.tip)
        if unfit := _unfit(system, data, arm):
            files = replace(files, strip=(*files.strip, *unfit))
            system, data, arm = _compiled(files, target, asked.tip)
        alone = compile_system(target, {}, time_step_s=_TIME_STEP_S)
        capture = plan_grasp(system, alone, data, arm, craft.base.halves[2], captured.grapple)
        mission = _mission(system, data, arm, capture, craft, target.strip, target_places)
        places = placed(asked.out, model, folders, asked.packages)
        scenario.write_text(mission_text(name, asked.robot.name, files.strip, craft, mission, places), encoding="utf-8")
        prepare(scenario)
    written = [path.name for path in (scenario, model, target_file) if path.exists()]
    return [
        f"files in {asked.out}: {', '.join(written)}",
        *_described(craft, system, data, mission),
        "; ".join((f"removed from the robot: {', '.join(files.strip) or 'nothing'}", *unfit.values())),
        f"next: {command('check', scenario)} && {command('run', scenario)}",
    ]


def _refuse_target(asked: TargetRequest) -> None:
    """Refuse options of a target that do not fit each other.

    Raises:
        InputError: See there.
    """
    ending = asked.file.suffix.lower() if asked.file is not None else ""
    if asked.file is not None and ending not in (*_MESHES, *_MODELS):
        allowed = f"an MJCF or URDF ({', '.join(_MODELS)}) or a mesh ({', '.join(_MESHES)})"
        raise InputError(f"new: --target: {asked.file} is neither {allowed}")
    if asked.file is not None and not asked.file.is_file():
        raise InputError(f"new: --target: no such file: {asked.file}")
    if asked.mass is not None and ending in _MODELS:
        raise InputError(f"new: --target-mass: {asked.file} has its masses; it is for a mesh or without --target")
    if asked.grapple and ending not in _MODELS:
        raise InputError("new: --grapple names a site of an MJCF or URDF given by --target")


def _craft(asked: RobotRequest, vendor: Vendor, axes: Sequence[Any], layout: Sequence[Any]) -> Craft:
    """The bus and its actuators, scaled by its mass."""
    mass = asked.base_mass or _BUS_KG
    wheel_mass = rounded(_WHEEL_PER_BUS * mass, 2)
    whole = cuboid(mass, asked.base_size)
    names = [
        [unused(f"{kind}_{i}", vendor.names) for i in range(1, count + 1)]
        for kind, count in (("wheel", len(axes)), ("jet", len(layout)))
    ]
    return Craft(
        base=replace(whole, mass=mass - len(axes) * wheel_mass),
        axes=axes,
        wheel=names[0],
        wheel_mass=wheel_mass,
        spin=rounded(_STORED_PER_KG * mass / _WHEEL_RAD_S, 2),
        most_torque=rounded(_TORQUE_PER_KG * mass, 2),
        most_speed=_WHEEL_RAD_S,
        jets=layout,
        jet=names[1],
        force=rounded(_FORCE_PER_KG * mass, 2),
        bus=unused("bus", vendor.names),
        free=unused("bus_free", vendor.names),
        unit=unused("imu", vendor.names),
    )


def _target(asked: RobotRequest, captured: TargetRequest, file: Path) -> tuple[ModelFiles, Places]:
    """Files of the target, and their paths in the scenario; a cuboid and the frame of a mesh are written.

    Raises:
        InputError: They cannot be used, or it does not float.
    """
    if captured.file is not None and captured.file.suffix.lower() in _MODELS:
        files = read_model(captured.file, (), asked.packages)
        files = replace(files, strip=tuple(needed_strips(files)))
        return files, placed(asked.out, captured.file, (), asked.packages if files.urdf else ())
    mass = captured.mass or rounded(_TARGET_PER_BUS * (asked.base_mass or _BUS_KG), 2)
    mesh = relative(captured.file, asked.out) if captured.file is not None else ""
    file.write_text(target_text(rounded(math.cbrt(mass / _TARGET_DENSITY), 2), mass, mesh), encoding="utf-8")
    folders = outside((captured.file or file).parent, asked.out)
    return read_model(file, folders), placed(asked.out, file, folders, ())


def _compiled(files: ModelFiles, target: ModelFiles, tip: str) -> tuple[System, Any, Arm]:
    """Spacecraft and target, the pose in which the spacecraft's file is, and its arm.

    Raises:
        InputError: One of them cannot be used.
    """
    pose = starting_pose(compile_system(files, {}, time_step_s=_TIME_STEP_S))
    system = compile_system(files, {"target": target}, time_step_s=_TIME_STEP_S)
    joint = system.objects[0].joints[0]
    if joint.kind != "free":
        raise InputError(f"new: --target: {target.place} floats on {joint.name!r}, a {joint.kind}; it needs a <freejoint/>")
    data = posed(system, pose)
    end = find_tip(system, data, tip)
    return system, data, find_arm(system, data, end, at_end=not (tip or end.site))


def _unfit(system: System, data: Any, arm: Arm) -> dict[str, str]:
    """Elements of the robot with which the mission does not come to its end, and why each is removed.

    By dry friction, a law that does not know it stops short of the target. Damping of a light link that decays within a
    small part of a step, as written for other simulators, has every step divided until the run is too long.
    """
    unfit = {}
    rub = system.mj.dof_frictionloss[arm.dofs] > 0.0
    if rub.any():
        names = ", ".join(_short(system, "joint", name) for name, rubs in zip(arm.joints, rub, strict=True) if rubs)
        unfit["frictionloss"] = f"dry friction of {names}, which the law 'track' does not know"
    decay = JointSprings(system.mj).fastest(system.mj, data)[1]
    if decay.rate * _TIME_STEP_S > _FASTEST_DECAY:
        joint = system.mj.joint(int(system.mj.dof_jntid[decay.dof])).name
        unfit["damping"] = (
            f"damping, by which {_short(system, 'joint', joint)!r} decays in {1e3 / decay.rate:.2g} ms, "
            f"far less than a step of {1e3 * _TIME_STEP_S:g} ms"
        )
    return unfit


def _short(system: System, kind: str, full: str) -> str:
    """A name without the prefix of its model where no other element of its kind has it."""
    tail = full.split("/", 1)[1]
    return tail if sum(name.split("/", 1)[-1] == tail for name in system.names(kind)) == 1 else full


def _mission(
    system: System, data: Any, arm: Arm, capture: GraspPlan, craft: Craft, target_strip: Sequence[str], places: Places
) -> Mission:
    """The numbers of the scenario."""
    model = system.mj
    start = capture.target
    data.qpos[arm.qpos] = capture.ready
    mujoco.mj_forward(model, data)
    inertia = mass_matrix(model, data)
    base = inertia[system.robot.base_dofs, system.robot.base_dofs]
    mass, moment = float(base[0, 0]), float(np.linalg.eigvalsh(base[3:, 3:])[-1])
    mobility = np.linalg.inv(inertia)[np.ix_(arm.dofs, arm.dofs)]
    fastest = _CONTROL_PERIOD_S * float(np.linalg.eigvalsh(mobility)[-1])
    body = model.body(arm.body).name.split("/", 1)[1]
    grasped = model.body(system.objects[0].root).name.split("/", 1)[1]
    sites = {name.split("/", 1)[1] for name in system.names("site")}
    servos = [model.actuator(a).name for a in arm.actuators if servo_mask(model)[a]]
    wheels = {f"robot/{wheel}" for wheel in craft.wheel}
    fingers = [name for name in motors_of_joints(system) if name not in arm.joints and name not in wheels]
    return Mission(
        joints=[_short(system, "joint", name) for name in arm.joints],
        servos=[_short(system, "actuator", name) for name in servos],
        fingers=[_short(system, "joint", name) for name in fingers],
        pose={
            _short(system, "joint", joint.name): float(data.qpos[joint.qpos.start])
            for joint in system.robot.joints
            if joint.kind in ("hinge", "slide") and joint.name not in wheels
        },
        tool=(unused("tool", sites), body, digits(arm.tool.origin, 6), digits(arm.tool.quaternion, 9)),
        target=places,
        target_strip=target_strip,
        free=_short(system, "joint", system.objects[0].joints[0].name),
        grapple=(
            unused("grapple", sites),
            grasped,
            digits(capture.grapple.origin, 6),
            digits(capture.grapple.quaternion, 9),
        ),
        start=(
            [*digits(capture.bus, 6), 1.0, 0.0, 0.0, 0.0],
            [*digits(start.pose[:3], 6), *digits(start.pose[3:], 9)],
            digits(start.rates, 8),
        ),
        way=capture.way,
        turns=capture.turns,
        damping=rounded(min(_MOST_DAMPED / fastest, _MOST_DAMPING), 2),
        # Near critical damping, with 0.6 rad/s of the position and 0.4 rad/s of the attitude.
        kp=rounded(0.35 * mass, 2),
        kd=rounded(1.25 * mass, 2),
        turn_kp=rounded(0.16 * moment, 2),
        turn_kd=rounded(0.6 * moment, 2),
    )


def _authority(system: System, data: Any, craft: Craft) -> Authority:
    """What the actuators of the compiled spacecraft can do, torques about the origin of the bus over half its mean edge."""
    model = system.mj
    columns = np.array([site_wrench(model, model.actuator(f"robot/{jet}").id) for jet in craft.jet]).T
    columns[3:] /= float(np.mean(craft.base.halves))
    stack = StackMomentum(system)
    wheels = [stack.wheels.index(f"robot/{wheel}") for wheel in craft.wheel]
    return authority(columns, stack.wheel_columns(data)[:, wheels] / craft.spin)


def _described(craft: Craft, system: System, data: Any, mission: Mission) -> list[str]:
    """What was chosen, as text."""
    can, model = _authority(system, data, craft), system.mj
    stored = rounded(craft.spin * craft.most_speed, 3)
    shape = {3: "along the axes", 4: "in a pyramid"}.get(len(craft.axes), "on a cone")
    by_wheels = "any torque can be commanded" if can.torque else "not every torque can be commanded"
    by_jets = (
        "any force and torque can be commanded" if can.wrench else "any force can be commanded, and torques by the wheels"
    )
    target = system.objects[0]
    weight = float(model.body_mass[list(target.bodies)].sum())
    return [
        f"bus: {craft.base.description}, and wheels of {craft.wheel_mass:g} kg each",
        f"wheels: {len(craft.axes)} {shape}, {stored:g} N m s and {craft.most_torque:g} N m each: {by_wheels}",
        f"thrusters: {len(craft.jets)} of {craft.force:g} N: {by_jets}",
        f"allocation of both: rank {can.rank} of 6, smallest over largest singular value {can.weakest:.2g}",
        f"arm: {', '.join(mission.joints)}; tool on body {mission.tool[1]!r}"
        + ("" if mission.turns else "; it cannot turn the tool every way, so the grasp closes at any angle"),
        f"target: {weight:.4g} kg, grasped at {mission.grapple[2]} m of body {mission.grapple[1]!r}",
        f"mission: {APPROACH_S:g} s of approach, {STAND_OFF_S:g} s of stand-off, capture, rest; {DURATION_S:g} s",
    ]
