"""Coordinates with dry friction, as a compiled scene has them: hinges, slides, and lengths of tendons."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.dynamics.loops.couplings import RestingCombination, RestingJoint, TendonRow
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.dynamics.springs import tendon_rows
from ffsm_mj.model.system import System, is_fixed_tendon, tendon_bodies, tendon_unit

_SHORTEST_M = 1e-6
"""Length below which a path counts as this long: its row turns at once where its ends pass each other."""


class FrictionCoordinates(NamedTuple):
    """The k coordinates with dry friction: hinges and slides in the order of their degrees of freedom, then tendons.

    Attributes:
        names: Full names of the joints and tendons.
        units: Units of the coordinates, ``rad`` or ``m``.
        dofs: Degrees of freedom of the joints in the logged system, (n,).
        limits: Greatest friction f: static as kinetic, N m or N, (k,); MuJoCo's ``frictionloss``, URDF's ``friction``.
        of_trees: Whether each is of a tree, the robot first, (number of trees, k).
        of_bases: Degrees of freedom of the bases of all trees in the logged system.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    dofs: IntArray
    limits: FloatArray
    of_trees: BoolArray
    of_bases: tuple[int, ...]

    @property
    def tendons(self) -> tuple[str, ...]:
        """Full names of the tendons."""
        return self.names[len(self.dofs) :]

    def at_rest(self, weights: FloatArray) -> RestingJoint | RestingCombination:
        """The row of a combination that is kept at rest, by weights of the coordinates, (k,)."""
        n = len(self.dofs)
        joints, tendons = np.flatnonzero(weights[:n]), np.flatnonzero(weights[n:])
        if len(joints) == 1 and not len(tendons):
            return RestingJoint(int(self.dofs[joints[0]]))
        return RestingCombination(
            tuple(self.dofs[joints].tolist()),
            tuple(weights[joints].tolist()),
            tuple(self.tendons[i] for i in tendons),
            tuple(weights[n + tendons].tolist()),
        )


def friction_coordinates(system: System) -> FrictionCoordinates | None:
    """Coordinates of a system that have dry friction; None: there are none."""
    model, loss = system.mj, system.mj.dof_frictionloss
    scalar = [
        candidate
        for candidate in system.joints.values()
        if candidate.kind in ("hinge", "slide") and loss[candidate.dofs.start] > 0.0
    ]
    joints, tendons = sorted(scalar, key=lambda joint: joint.dofs.start), np.flatnonzero(model.tendon_frictionloss > 0.0)
    if not joints and not len(tendons):
        return None
    dofs = np.array([joint.dofs.start for joint in joints], dtype=np.intp)
    roots = [int(model.body_dofadr[model.body_rootid[max(tendon_bodies(model, t))]]) for t in tendons.tolist()]
    return FrictionCoordinates(
        (*(joint.name for joint in joints), *(str(model.tendon(t).name) for t in tendons.tolist())),
        (
            *("rad" if joint.kind == "hinge" else "m" for joint in joints),
            *(tendon_unit(model, t) for t in tendons.tolist()),
        ),
        dofs,
        np.concatenate((loss[dofs], model.tendon_frictionloss[tendons])),
        np.array([[tree.dofs.start <= dof < tree.dofs.stop for dof in (*dofs, *roots)] for tree in system.trees]),
        tuple(dof for tree in system.trees for dof in range(tree.base_dofs.start, tree.base_dofs.stop)),
    )


class CoordinatesOfMotion:
    """These coordinates in a motion, at the state in its data.

    Attributes:
        moving: Coordinates whose rows depend on the configuration, (k,): lengths of spatial tendons.
    """

    def __init__(self, on: FrictionCoordinates, motion: Motion) -> None:
        """Look up their places in the model of a motion."""
        self._model, self._data = model, data = motion.model, motion.data
        self._dofs = np.array([motion.dofs[dof] for dof in on.dofs], dtype=np.intp)
        self._places = model.jnt_qposadr[model.dof_jntid[self._dofs]].astype(np.intp)
        self._tendons = np.array([model.tendon(name).id for name in on.tendons], dtype=np.intp)
        self._units, n = np.eye(model.nv)[self._dofs], len(self._dofs)
        paths = {n + i: TendonRow(model, data, name) for i, name in enumerate(on.tendons)}
        self._paths = {i: paths[i] for i, t in enumerate(self._tendons.tolist(), n) if not is_fixed_tendon(model, t)}
        self.moving: BoolArray = np.zeros(len(on.names), dtype=np.bool_)
        self.moving[[*self._paths]] = True
        # These only scale what is brief and how fast rows turn: those of constant rows need not follow the pose.
        self._mobilities = np.concatenate((model.dof_invweight0[self._dofs], model.tendon_invweight0[self._tendons]))
        self._stages: list[FloatArray] = []
        self._motion, self._internal = motion, np.ones(model.nv, dtype=np.bool_)
        # Motion of the base turns all links alike, and no row of a tendon against them.
        self._internal[[motion.dofs[dof] for dof in on.of_bases if motion.dofs[dof] >= 0]] = False

    def values(self) -> FloatArray:
        """Coordinates and lengths, (k,)."""
        of_joints: FloatArray = self._data.qpos[self._places]
        return np.concatenate((of_joints, self._data.ten_length[self._tendons])) if len(self._tendons) else of_joints

    def rates(self) -> FloatArray:
        """Their rates, (k,)."""
        qvel = self._data.qvel
        of_joints: FloatArray = qvel[self._dofs]
        # Not data.ten_velocity: an impact may have changed the rates since.
        return np.concatenate((of_joints, self._rows_of_tendons() @ qvel)) if len(self._tendons) else of_joints

    def rows(self) -> FloatArray:
        """Rates as functions of the generalised velocity, (k, nv)."""
        return np.concatenate((self._units, self._rows_of_tendons())) if len(self._tendons) else self._units

    def mobilities(self) -> FloatArray:
        """Inverse inertias of the coordinates, (k,): of constant rows at the reference pose, of others here."""
        # The gradient of a spatial tendon's length may vanish in one pose and not in another.
        if self._paths:
            rows = self._rows_of_tendons()[self.moving[len(self._dofs) :]]
            response = np.empty_like(rows)
            mujoco.mj_solveM(self._model, self._data, response, rows)
            self._mobilities[self.moving] = np.einsum("ij,ij->i", response, rows)
        return self._mobilities

    def turning_rate(self, forces: FloatArray) -> float:
        """Rate at which given forces along the coordinates, (k,), change as their rows turn with the motion, rad/s.

        A row R with R' = H v makes of a force f the stiffness f H. Along the motion v of the joints it is f v^T H v over
        v^T M v, the square of this rate; and a path that these forces make shorter or longer by a share of its length within
        a time turns its row by as much.
        """
        fastest, v = 0.0, np.where(self._internal, self._data.qvel, 0.0)
        twice = float(v @ mass_matrix(self._model, self._data) @ v)
        mobilities, lengths = self.mobilities(), self.values()
        for i, path in self._paths.items():
            # Without motion no row turns at a rate, but a path may still be short.
            bend = abs(path.row()[1]) / twice if twice > 0.0 else 0.0
            fastest = max(fastest, abs(forces[i]) * max(bend, float(mobilities[i] / max(lengths[i], _SHORTEST_M))))
        return float(np.sqrt(fastest))

    def second_rates(self) -> FloatArray:
        """Second rates at zero generalised acceleration, (k,)."""
        gamma = np.zeros(len(self.moving))
        for i, path in self._paths.items():
            gamma[i] = path.row()[1]
        return gamma

    def _rows_of_tendons(self) -> FloatArray:
        return tendon_rows(self._model, self._data)[self._tendons]

    def add(self, applied: FloatArray, forces: FloatArray) -> None:
        """Add forces along the coordinates, (k,), to generalised forces, (nv,)."""
        n = len(self._dofs)
        applied[self._dofs] += forces[:n]
        if len(self._tendons):
            applied += forces[n:] @ self._rows_of_tendons()

    def stop(self, which: BoolArray) -> None:
        """Remove what rounding has left of the rates of joints at rest."""
        # Joints alone: the rate of a tendon is a sum of several, which the projection has brought to zero.
        self._data.qvel[self._dofs[which[: len(self._dofs)]]] = 0.0

    # ---- Ways in a step

    def begin_step(self) -> None:
        """Begin a (sub-)step at the state in ``data``."""
        self._stages.clear()
        self.start_rates = self.rates()

    def add_stage(self) -> None:
        """Add the rates in a stage of the step."""
        stepper = self._motion.forced_stepper
        if not len(self._tendons) or stepper is None:
            return
        rates = self._rows_of_tendons() @ self._data.qvel
        # An implicit step evaluates its nodes in several passes, of which the last one counts.
        if stepper.repeats:
            self._stages[stepper.repeats] = rates
        else:
            self._stages.append(rates)

    def ways(self, duration_s: float) -> FloatArray:
        """Ways in the step, (k,): of joints by their ends, of tendons the integrals of the rates by the stages' weights."""
        # The path begins after projections, whose displacement does no work.
        of_joints: FloatArray = self._data.qpos[self._places] - self._motion.path.start[1 + self._places]
        stepper = self._motion.forced_stepper
        if not len(self._tendons) or stepper is None:
            return of_joints
        weights = duration_s * stepper.weights
        # The last entry of all is the evaluation at the end of the step.
        return np.concatenate((of_joints, weights @ np.array(self._stages[-1 - len(weights) : -1])))
