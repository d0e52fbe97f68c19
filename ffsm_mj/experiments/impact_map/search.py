"""Overlaps of geoms at a configuration, which would make it impossible."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import Bounds, minimize

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.experiments.impact_map.evaluation import OBJECTIVES, Evaluation
from ffsm_mj.experiments.impact_map.self_motion import REACHED, SelfMotion
from ffsm_mj.experiments.impact_map.target import Target

_FAR_M = 10.0
"""Distances are computed up to this."""

Geoms = tuple[int, int]


class Overlaps:
    """Overlaps of any two geoms that can collide, but the pair in contact and what the scenario ignores."""

    def __init__(self, target: Target) -> None:
        """Build data of its own."""
        self._model, self._data = target.system.mj, target.data()
        self._watch = ContactWatch(self._model, self._data, target.ignored | {target.pair.geom_ids})

    def at(self, qpos: FloatArray) -> dict[Geoms, float]:
        """Depth of each overlap at a configuration in m, the deepest first."""
        self._place(qpos)
        self._watch.look(0.0)
        found = {
            tuple(self._model.geom(name).id for name in each.geoms): each.max_depth_m for each in self._watch.finish(0.0)
        }
        return {(a, b): found[a, b] for a, b in sorted(found, key=lambda pair: -found[pair])}

    def names(self, geoms: Geoms) -> str:
        """Two geoms as text."""
        return " and ".join(sorted(self._model.geom(geom).name for geom in geoms))

    def distances(self, qpos: FloatArray, pairs: Sequence[Geoms]) -> FloatArray:
        """Signed distance of each pair at a configuration, m."""
        self._place(qpos)
        return np.array([mujoco.mj_geomDistance(self._model, self._data, a, b, _FAR_M, None) for a, b in pairs])

    def _place(self, qpos: FloatArray) -> None:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)


_TRUST = 1.0
"""Largest displacement of a joint, rad or m, before the coordinates of an optimisation are centred again."""
_ROUNDS, _ITERATIONS = 8, 25
_SETTLED = 1e-9
"""Improvement of a round, as a share of the effect at the start, below which an optimisation ends."""
_RANK = 1e-9
"""Singular values below this share of the largest are zero."""
_CLEARANCE_M = 1e-6
"""Distance that an optimisation keeps between geoms that would overlap."""
_MOST_REPAIRS = 3


@dataclass(frozen=True)
class Objective:
    """An effect to make small or large.

    Attributes:
        effect: One of :data:`~ffsm_mj.experiments.impact_map.evaluation.OBJECTIVES`.
        maximize: Whether to make it large.
    """

    effect: str
    maximize: bool = False

    def __post_init__(self) -> None:
        """Check the name."""
        if self.effect not in OBJECTIVES:
            raise InputError(f"objective: {unknown_name('effect', self.effect, OBJECTIVES)}")

    def cost(self, effects: dict[str, float]) -> float:
        """What an optimisation makes small."""
        return -effects[self.effect] if self.maximize else effects[self.effect]


def sampled(motion: SelfMotion, count: int, seed: int) -> Iterator[tuple[FloatArray, float]]:
    """Configurations that reach the contact from drawn ones, with their residuals; a large one does not reach it."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        yield motion.projected(motion.drawn(random))


class Optimizer:
    """Local optima of an effect: sequential quadratic programming (SLSQP) in displacements of the joints.

    The conditions of the contact are equalities, the ranges of joints are bounds. Geoms that overlap at an optimum must stay
    apart in a further optimisation from the same start.
    """

    def __init__(self, motion: SelfMotion, evaluation: Evaluation, overlaps: Overlaps, objective: Objective) -> None:
        self._motion, self._evaluation, self._overlaps, self._objective = motion, evaluation, overlaps, objective

    def optimum(self, qpos: FloatArray, *, overlaps: bool) -> FloatArray:
        """A local optimum near a configuration; without ``overlaps``, one that does not overlap unless that fails."""
        apart: list[Geoms] = []
        best = self._settled(qpos, apart)
        for _ in range(0 if overlaps else _MOST_REPAIRS):
            new = [pair for pair in self._overlaps.at(best) if pair not in apart]
            if not new:
                break
            apart += new
            best = self._settled(qpos, apart)
        return best

    def _cost(self, qpos: FloatArray) -> float:
        return self._objective.cost(self._evaluation.effects(qpos))

    def _settled(self, qpos: FloatArray, apart: Sequence[Geoms]) -> FloatArray:
        """Result of rounds of optimisation, each centred at the result of the one before."""
        cost = self._cost(qpos)
        scale = abs(cost) or 1.0
        for _ in range(_ROUNDS):
            better = self._improved(qpos, apart, scale)
            if better is None or self._cost(better) >= cost:
                break
            gain, qpos, cost = cost - self._cost(better), better, self._cost(better)
            if gain <= _SETTLED * scale:
                break
        return qpos

    def _improved(self, qpos: FloatArray, apart: Sequence[Geoms], scale: float) -> FloatArray | None:
        """Result of one optimisation; None if it does not reach the contact."""
        motion = self._motion
        left, values, _ = np.linalg.svd(motion.residual(qpos)[1], full_matrices=False)
        # SLSQP needs conditions of full rank: a planar arm, say, cannot leave its plane.
        independent = left[:, values > _RANK * values[0]].T

        def at(step: FloatArray) -> FloatArray:
            return motion.displaced(qpos, step)

        conditions = [{"type": "eq", "fun": lambda step: independent @ motion.residual(at(step))[0]}]
        if apart:
            conditions.append({"type": "ineq", "fun": lambda step: self._overlaps.distances(at(step), apart) - _CLEARANCE_M})
        found = minimize(
            lambda step: self._cost(at(step)) / scale,
            np.zeros(len(motion.dofs)),
            method="SLSQP",
            bounds=_bounds(motion, qpos),
            constraints=conditions,
            options={"maxiter": _ITERATIONS, "ftol": 1e-11},
        )
        if not np.isfinite(found.x).all():
            return None
        there, residual = motion.projected(at(found.x))
        overlaps = len(apart) > 0 and float(self._overlaps.distances(there, apart).min()) < 0.0
        return there if residual <= REACHED and not overlaps else None


def _bounds(motion: SelfMotion, qpos: FloatArray) -> Bounds:
    """Bounds of the displacements: those of the joints, and of the trust region."""
    low, high = np.full(len(motion.dofs), -_TRUST), np.full(len(motion.dofs), _TRUST)
    joints = {joint.dofs.start: joint for joint in motion.target.system.robot.joints}
    for i, dof in enumerate(motion.dofs.tolist()):
        if dof in motion.bounds:
            least, most = (bound - float(qpos[joints[dof].qpos.start]) for bound in motion.bounds[dof])
            low[i], high[i] = max(low[i], min(least, 0.0)), min(high[i], max(most, 0.0))
    return Bounds(low, high)
