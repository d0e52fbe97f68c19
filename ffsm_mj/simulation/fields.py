"""External fields as a source of forces, in whatever motion is integrated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.fields import Bodies, CompiledField, FieldForces
from ffsm_mj._core.magnetic import MagneticField, Magnetorquers, TorqueSample
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.interface import ForceOrder, ForceSource, Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.fields.interface import Field
from ffsm_mj.model.magnetorquers import Magnetorquer
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.contact_forces import Wrench
from ffsm_mj.records.signals import Signal, identifier
from ffsm_mj.state import get_states, set_states
from ffsm_mj.unchanging import with_state


def moving_bodies(system: System) -> tuple[list[int], list[int]]:
    """Ids of the moving bodies of a system, and the index of the tree of each."""
    pairs = sorted((body, i) for i, tree in enumerate(system.trees) for body in tree.bodies)
    return [body for body, _ in pairs], [tree for _, tree in pairs]


def bodies_of(system: System) -> Bodies:
    """The moving bodies of a system."""
    ids, _ = moving_bodies(system)
    model = system.mj
    return Bodies([model.body(i).name for i in ids], model.body_mass[ids], model.body_inertia[ids])


def magnetorquers_in(
    model: Any, bodies: Bodies, magnetorquers: Sequence[Magnetorquer], magnetic: MagneticField
) -> Magnetorquers:
    """Magnetorquers as a field on the bodies of a model.

    Args:
        model: MuJoCo model, with the magnetorquers as actuators.
        bodies: Its moving bodies.
        magnetorquers: The magnetorquers.
        magnetic: The magnetic field.
    """
    actuators = [int(model.actuator(one.name).id) for one in magnetorquers]
    places, axes = list[int](), []
    for one, actuator in zip(magnetorquers, actuators, strict=True):
        site = int(model.actuator_trnid[actuator, 0])
        body = int(model.site_bodyid[site])
        places.append(bodies.names.index(model.body(body).name))
        axis = rotation_matrix(model.site_quat[site])[:, "xyz".index(one.axis)]
        # Bodies have their principal axes in world axes.
        axes.append(np.asarray(rotation_matrix(model.body_iquat[body]).T @ axis))
    return Magnetorquers(actuators, places, axes, magnetic)


def _torque_signals(system: System) -> Iterator[Signal]:
    for one in system.magnetorquers:
        for axis in "xyz":
            text = f"torque of {one.name} on its body, world axes"
            yield Signal("actuators", f"{identifier(one.name)}_torque_{axis}_N_m", "N m", text, f"actuator {one.name}")


class ExternalFields(ForceSource):
    """Forces of the external fields of a scenario; the motions' steps integrate their work and impulses.

    Attributes:
        done: Work and impulse (P, L about the world origin) in the last (sub-)step, J, N s and N m s, (trees, 7).
        acting: The fields that are not of the core.
        forces: The forces in the current motion.
    """

    kind = "external fields"
    active = True
    order = ForceOrder.EXTERNAL

    def __init__(
        self, scene: Scene, fields: Sequence[Field], *compiled: CompiledField, magnetic: MagneticField | None = None
    ) -> None:
        """Act on the bodies of a scene.

        Args:
            scene: The scene.
            fields: Fields that are not of the core.
            compiled: Fields of the core, which are without memory.
            magnetic: Magnetic field, in which the magnetorquers of the scene act; None: there are none.
        """
        super().__init__(scene)
        self._magnetic = magnetic
        self.acting = tuple(fields)
        self._fields: tuple[Field | CompiledField, ...] = (*compiled, *fields)
        self.done = np.zeros((len(scene.system.trees), 7))
        self._stateful = {
            f"{source.kind} {i}": with_state(source, f"the external field {source.kind!r}")
            for i, source in enumerate(fields)
        }
        self._ids, self._trees = moving_bodies(scene.system)
        self._torquers = self._torquers_of(scene.system, bodies_of(scene.system))
        for torquers in self._torquers:
            sample = TorqueSample(torquers, self, scene.data.ctrl)
            self.columns = (Columns(tuple(_torque_signals(scene.system)), live=sample.row, on_sample=sample),)

    def bind(self, motion: Motion) -> None:
        """Act in another motion."""
        super().bind(motion)
        if motion.field is None:
            ids, bodies = [motion.bodies[body] for body in self._ids], bodies_of(self.scene.system)
            fields = (*self._fields, *self._torquers)
            motion.field = FieldForces(motion.model, motion.data, ids, self._trees, bodies, fields, self.done)
        self.forces = motion.field
        self.push = self.forces.push  # type: ignore[method-assign]  # stages of a step call the core, not Python

    def _torquers_of(self, system: System, bodies: Bodies) -> tuple[Magnetorquers, ...]:
        """The magnetorquers of a system as one field; none: there are none."""
        if self._magnetic is None:
            return ()
        return (magnetorquers_in(system.mj, bodies, system.magnetorquers, self._magnetic),)

    def forces_in(self, system: System) -> FieldForces:
        """The forces in another system with the same bodies, as a control law knows it, at the state in any data of it."""
        names = self.forces.bodies.names
        ids = [system.index("body", name) for name in names]
        bodies = Bodies(names, system.mj.body_mass[ids], system.mj.body_inertia[ids])
        done, data = np.zeros((1, 7)), mujoco.MjData(system.mj)
        fields = (*self._fields, *self._torquers_of(system, bodies))
        return FieldForces(system.mj, data, ids, [0] * len(ids), bodies, fields, done)

    def get_state(self) -> dict[str, Any]:
        """What fields of packages remember: those that say so have a state, others must not."""
        return get_states(self._stateful)

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        set_states(self._stateful, state, "ExternalFields")

    def add_forces(self, applied: FloatArray) -> None:
        """Add the generalised forces at the state of the motion to an array, (nv,)."""
        self.forces.add_to(self.motion.data, applied)

    def wrenches(self, data: Any) -> Sequence[Wrench]:  # noqa: ARG002
        """Force and torque on each body of the logged system, at its mass centre."""
        self.forces.evaluate_now()
        bodies = self.forces.bodies
        parts = zip(self._ids, bodies.position_m.copy(), bodies.force_N.copy(), bodies.torque_N_m.copy(), strict=True)
        return [Wrench(*part, by="field") for part in parts]
