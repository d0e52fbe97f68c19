"""Columns of an orbit: the reference, the potential of the field, and robot and objects in LVLH axes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.fields import OrbitalField
from ffsm_mj._core.tick import BlockSampler, Sampler
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.fields.orbit import Orbit
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import POTENTIAL, Signal, identifier, unit_of
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


class OrbitSamples:
    """Samples what the columns of an orbit need; they are computed for many samples at once.

    Attributes:
        columns: The columns.
    """

    def __init__(self, orbit: Orbit, field: OrbitalField, fields: ExternalFields, room: int) -> None:
        """Begin without samples.

        Args:
            orbit: The orbit.
            field: Its field.
            fields: All fields, which know the bodies of the current motion.
            room: Capacity in samples.
        """
        self._orbit, self._field, self._fields = orbit, field, fields
        system, data = fields.scene.system, fields.scene.data
        self._scalars = np.empty((room, 2))
        live: list[FloatArray] = []
        self._roots = [tree.root for tree in system.trees]
        for root in self._roots:
            centre = data.subtree_com[int(system.mj.body_rootid[root])]
            live += [data.xpos[root], data.xmat[root], data.cvel[root], centre]
        self._tables = [np.empty((room, *values.shape)) for values in live]
        sampler = Sampler(system.mj, data)
        sampler.copy(list(zip(live, self._tables, strict=True)))
        self._block = BlockSampler(sampler)
        self.columns = Columns(tuple(_signals(system)), table=self._table, on_sample=self._sample)

    def _sample(self, time_s: float) -> None:
        forces = self._fields.forces
        forces.evaluate_now()
        self._scalars[self._block.used] = time_s, self._field.potential(time_s, forces.bodies)
        self._block(time_s)

    def _table(self) -> FloatArray:
        """Values of the columns at the samples since the last call, (n, number of signals)."""
        used, self._block.used = self._block.used, 0
        scalars = self._scalars[:used]
        R, V = self._orbit.states(scalars[:, 0])
        axes, spin = self._orbit.lvlh(R, V)
        parts = [R, V, scalars[:, 1:]]
        for i in range(len(self._roots)):
            position, attitude, twist, centre = (table[:used] for table in self._tables[4 * i : 4 * i + 4])
            velocity = twist[:, 3:] + np.cross(twist[:, :3], position - centre)
            parts += relative_state(axes, spin, position, velocity, attitude.reshape(-1, 3, 3), twist[:, :3])
        return np.concatenate(parts, axis=1)


def relative_state(axes: FloatArray, spin: FloatArray, *world: FloatArray) -> tuple[FloatArray, ...]:
    """State of a body relative to rotating axes: position, velocity, attitude and angular velocity as the columns have them.

    Args:
        axes: Axes as columns in world axes, (n, 3, 3).
        spin: Their angular velocity, world axes, rad/s, (n, 3).
        world: Position, velocity, rotation matrix and angular velocity in world axes, (n, 3), (n, 3), (n, 3, 3), (n, 3).
    """
    position, velocity, rotations, turning = world
    relative = np.einsum("nji,njk->nik", axes, rotations)
    return (
        np.einsum("nji,nj->ni", axes, position),
        np.einsum("nji,nj->ni", axes, velocity - np.cross(spin, position)),
        _quaternions(relative),
        np.einsum("nji,nj->ni", rotations, turning - spin),
    )


def world_state(axes: FloatArray, spin: FloatArray, *relative: FloatArray) -> tuple[FloatArray, ...]:
    """The inverse for one body: position, velocity, attitude in world axes, and angular velocity in the body's axes."""
    position, velocity, attitude, turning = relative
    rotations = axes @ rotation_matrix(attitude)
    there = axes @ position
    return there, axes @ velocity + np.cross(spin, there), _quaternions(rotations[None])[0], turning + rotations.T @ spin


def _quaternions(matrices: FloatArray) -> FloatArray:
    """Unit quaternions of rotation matrices, w from 0 on, (n, 4)."""
    quaternions = np.empty((len(matrices), 4))
    for quaternion, matrix in zip(quaternions, matrices, strict=True):
        mujoco.mju_mat2Quat(quaternion, matrix.ravel())
    return np.where(quaternions[:, :1] < 0.0, -quaternions, quaternions)


def start_in_world(orbit: Orbit, system: System, data: Any) -> None:
    """Replace coordinates and rates of free joints, stated relative to LVLH axes at t = 0, by those in world axes."""
    R, V = orbit.states(np.zeros(1))
    axes, spin = (part[0] for part in orbit.lvlh(R, V))
    for joint in system.joints.values():
        if joint.kind == "free":
            q, v = data.qpos[joint.qpos], data.qvel[joint.dofs]
            state = world_state(axes, spin, q[:3].copy(), v[:3].copy(), q[3:].copy(), v[3:].copy())
            q[:3], v[:3], q[3:], v[3:] = state
