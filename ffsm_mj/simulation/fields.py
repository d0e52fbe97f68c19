"""External fields as a source of forces, in whatever motion is integrated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj._core.fields import Bodies, CompiledField, FieldForces
from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.interface import ForceOrder, ForceSource, Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.fields.interface import Field
from ffsm_mj.model.system import System
from ffsm_mj.records.contact_forces import Wrench
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

    def __init__(self, scene: Scene, fields: Sequence[Field], *compiled: CompiledField) -> None:
        """Act on the bodies of a scene; the fields of the core are without memory."""
        super().__init__(scene)
        self.acting = tuple(fields)
        self._fields: tuple[Field | CompiledField, ...] = (*compiled, *fields)
        self.done = np.zeros((len(scene.system.trees), 7))
        self._stateful = {
            f"{source.kind} {i}": with_state(source, f"the external field {source.kind!r}")
            for i, source in enumerate(fields)
        }
        self._ids, self._trees = moving_bodies(scene.system)

    def bind(self, motion: Motion) -> None:
        """Act in another motion."""
        super().bind(motion)
        if motion.field is None:
            ids, bodies = [motion.bodies[body] for body in self._ids], bodies_of(self.scene.system)
            motion.field = FieldForces(motion.model, motion.data, ids, self._trees, bodies, self._fields, self.done)
        self.forces = motion.field
        self.push = self.forces.push  # type: ignore[method-assign]  # stages of a step call the core, not Python

    def forces_in(self, system: System) -> FieldForces:
        """The forces in another system with the same bodies, as a control law knows it, at the state in any data of it."""
        names = self.forces.bodies.names
        ids = [system.index("body", name) for name in names]
        bodies = Bodies(names, system.mj.body_mass[ids], system.mj.body_inertia[ids])
        done, data = np.zeros((1, 7)), mujoco.MjData(system.mj)
        return FieldForces(system.mj, data, ids, [0] * len(ids), bodies, self._fields, done)

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
        return [Wrench(*part) for part in parts]
