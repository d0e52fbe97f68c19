"""Columns of an orbit: the reference, the potential of the field, and robot and objects in LVLH axes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.orbit import OrbitalField, OrbitSample
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.fields.orbit import Orbit
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import POTENTIAL, Signal, identifier, unit_of
from ffsm_mj.scenario.environment import EnvironmentConfig
from ffsm_mj.simulation.fields import ExternalFields

_REFERENCE = (
    *(Signal("orbit", f"R_{axis}_m", "m", "position of the origin from the central body, world axes") for axis in "xyz"),
    *(Signal("orbit", f"V_{axis}_m_s", "m/s", "velocity of the origin, world axes") for axis in "xyz"),
)
_OF_TREE = (
    *((f"{{}}_{axis}_m", "position of the base of the {}, LVLH axes") for axis in "xyz"),
    *((f"{{}}_v{axis}_m_s", "velocity of the base of the {} relative to the rotating LVLH axes, in them") for axis in "xyz"),
    *((f"{{}}_q{part}", "attitude of the base of the {}: its axes to LVLH axes, w from 0 on") for part in "wxyz"),
    *((f"{{}}_w{axis}_rad_s", "angular velocity of the base of the {} relative to LVLH, its own axes") for axis in "xyz"),
)


def _signals(system: System) -> Iterator[Signal]:
    yield from _REFERENCE
    yield Signal("orbit", POTENTIAL, "J", "potential of tide and gravity gradient, without J2, of all bodies")
    for tree in system.trees:
        for name, meaning in _OF_TREE:
            full = name.format(identifier(tree.name))
            yield Signal("orbit", full, unit_of(full), meaning.format(tree.name), f"body {system.mj.body(tree.root).name}")


def orbit_columns(field: OrbitalField, fields: ExternalFields) -> Columns:
    """Columns of an orbit.

    Args:
        field: Field of the orbit.
        fields: All fields, which know the bodies of the current motion.
    """
    system, data = fields.scene.system, fields.scene.data
    sample = OrbitSample(field, fields, system.mj, data, [tree.root for tree in system.trees])
    return Columns(tuple(_signals(system)), live=sample.row, on_sample=sample)


def orbit_of(environment: EnvironmentConfig | None) -> Orbit | None:
    """The orbit of the origin of a scene; None: there is none."""
    if environment is None or environment.orbit is None:
        return None
    return Orbit.of(environment.orbit, environment.world_axes)


def world_state(axes: FloatArray, spin: FloatArray, *relative: FloatArray) -> tuple[FloatArray, ...]:
    """State of a body in world axes.

    Args:
        axes: Rotating axes as columns in world axes, (3, 3).
        spin: Their angular velocity, world axes, rad/s, (3,).
        relative: Position, velocity and attitude (quaternion) relative to them, and angular velocity relative to them in the
            body's axes.

    Returns:
        Position, velocity and attitude in world axes, and angular velocity in the body's axes.
    """
    position, velocity, attitude, turning = relative
    rotations = axes @ rotation_matrix(attitude)
    there, quaternion = axes @ position, np.empty(4)
    mujoco.mju_mat2Quat(quaternion, rotations.ravel())
    quaternion = -quaternion if quaternion[0] < 0.0 else quaternion
    return there, axes @ velocity + np.cross(spin, there), quaternion, turning + rotations.T @ spin


def start_in_world(orbit: Orbit, system: System, data: Any) -> None:
    """Replace coordinates and rates of free joints, stated relative to LVLH axes at t = 0, by those in world axes."""
    R, V = orbit.states(np.zeros(1))
    axes, spin = (part[0] for part in orbit.lvlh(R, V))
    for joint in system.joints.values():
        if joint.kind == "free":
            q, v = data.qpos[joint.qpos], data.qvel[joint.dofs]
            state = world_state(axes, spin, q[:3].copy(), v[:3].copy(), q[3:].copy(), v[3:].copy())
            q[:3], v[:3], q[3:], v[3:] = state
