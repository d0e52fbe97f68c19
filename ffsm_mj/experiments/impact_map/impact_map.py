"""The map of one contact: effects of the impact over the configurations of the arm that reach it, and the best of them."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.optimize import Bounds, minimize

from ffsm_mj.analysis.tables import Table
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.process import one_blas_thread
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.experiments.impact_map.evaluation import OBJECTIVES, Configuration, Evaluation, Origin, initial_block, table_of
from ffsm_mj.experiments.impact_map.reach import REACHED, ArrivalRates, Hold, SelfMotion, Target, Vector, moved, target_of
from ffsm_mj.records.signals import identifier
from ffsm_mj.scenario.overrides import Overrides
from ffsm_mj.tolerances import CONTACT_GAP_M

_FAR_M = 10.0
"""Distances are computed up to this: beyond the reach of arms, as an optimisation needs the distance of pairs far apart."""

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
        depths = {
            tuple(self._model.geom(name).id for name in overlap.geoms): overlap.max_depth_m
            for overlap in self._watch.finish(0.0)
        }
        return {(a, b): depths[a, b] for a, b in sorted(depths, key=lambda pair: -depths[pair])}

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
"""Rounds of optimisation, which together reach any angle with steps of 1 rad, and iterations of one: SLSQP converges faster
than linearly, and what a round leaves the next one does."""
_SETTLED = 1e-9
"""Improvement of a round, as a share of the effect at the start, below which an optimisation ends."""
_RANK = 1e-9
"""Singular values below this share of the largest are zero."""
_CLEARANCE_M = 1e-6
"""Distance that an optimisation keeps between geoms that would overlap."""
_MOST_REPAIRS = 3
"""Further optimisations, each with the overlaps of the one before kept apart: a start that still overlaps is given up."""


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
        optimum = minimize(
            lambda step: self._cost(at(step)) / scale,
            np.zeros(len(motion.dofs)),
            method="SLSQP",
            bounds=_bounds(motion, qpos),
            constraints=conditions,
            options={"maxiter": _ITERATIONS, "ftol": 1e-11},
        )
        if not np.isfinite(optimum.x).all():
            return None
        there, residual = motion.projected(at(optimum.x))
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


_SAME_NORMAL = 1e-6
"""Largest angle between the normal of a target and that of its geoms, rad."""


@dataclass(frozen=True, eq=False)
class ImpactMap:
    """Effects of one impact over the configurations of the arm that reach its contact.

    Attributes:
        target: The contact.
        objective: The effect that the best configuration makes small or large.
        configurations: That of the run first, if the target is its impact, then samples and optima in order.
        drawn: Number of drawn configurations, of which some do not reach the contact.
        reached: Number of those that do.
        allow_overlaps: Whether the best configuration may overlap.
        joint_keys: Names that the scenario gives joints, by full name.
    """

    target: Target
    objective: Objective
    configurations: tuple[Configuration, ...]
    drawn: int
    reached: int
    allow_overlaps: bool
    joint_keys: Mapping[str, str]

    @cached_property
    def best(self) -> Configuration:
        """The configuration of the best effect among those that a run can reach.

        Raises:
            InputError: There is none.
        """
        allowed = [one for one in self.configurations if self.allows(one)]
        if not allowed:
            why = ", ".join(sorted({one.status for one in self.configurations}))
            raise InputError(f"no run can begin at any of the {len(self.configurations)} configurations: {why}")
        return min(allowed, key=lambda one: self.objective.cost(one.effects))

    @property
    def of_run(self) -> Configuration | None:
        """The configuration at which the scenario arrives; None if the target was moved."""
        first = self.configurations[0]
        return first if first.origin == "run" else None

    def allows(self, configuration: Configuration) -> bool:
        """Whether a configuration can be the best one: it has rates, and no overlap unless these are allowed."""
        return configuration.qvel is not None and (self.allow_overlaps or configuration.overlap_m == 0.0)

    @property
    def arm_names(self) -> list[str]:
        """Names of the arm's joints, as in the columns of the table."""
        return [identifier(joint.name) for joint in self.target.joints]

    @cached_property
    def table(self) -> Table:
        """One row per configuration: coordinates, effects, changes of the rates, overlap."""
        return table_of(self.target, self.configurations)

    def initial(self, configuration: Configuration | None = None) -> dict[str, Any]:
        """``initial`` of a scenario that begins at a configuration, just before the impact; of the best without one."""
        return initial_block(self.target.system, configuration or self.best, dict(self.joint_keys))


def impact_map(
    scenario: str | Path,
    overrides: Overrides = (),
    *,
    impact: int = 1,
    point: Vector | None = None,
    normal: Vector | None = None,
    hold: Hold = "com",
    objective: str = "impulse_N_s",
    maximize: bool = False,
    bounds: Mapping[str, Vector] | None = None,
    samples: int = 400,
    starts: int = 8,
    seed: int = 0,
    allow_overlaps: bool = False,
    report: Callable[[float, float], None] | None = None,
) -> ImpactMap:
    """Map what an impact of a scenario does, over the configurations of the arm that reach the same contact.

    In all of them the robot touches the same point with the same normal and the same velocity relative to it, and has the
    momenta of the run. See docs/impact-map.md.

    Args:
        scenario: A path, or the name of a shipped scenario; it is simulated up to the impact.
        overrides: See :func:`ffsm_mj.run`.
        impact: Which impact of the run, from 1.
        point: Another contact point in world axes at the instant of the impact, m.
        normal: Another normal, from the robot to the object.
        hold: What of a floating base is kept: ``com``, the robot's centre of mass, which motors cannot move; ``base``, the
            pose of the base; ``nothing``.
        objective: Effect that the best configuration makes small: ``impulse_N_s``, ``base_rate_change_rad_s``,
            ``object_spin_rad_s``, ...
        maximize: Make it large.
        bounds: Narrower ranges of hinges and slides by joint, (low, high), rad or m.
        samples: Number of configurations to draw.
        starts: Number of optimisations, from the best samples.
        seed: Seed of the samples.
        allow_overlaps: Whether the best configuration may overlap.
        report: Told (done, total).

    Raises:
        InputError: The scenario has no such impact, a name is unknown, or no configuration reaches the contact.
    """
    wanted = Objective(objective, maximize)
    if samples < 1 or starts < 0:
        raise InputError(f"samples: {samples}, starts: {starts}; at least 1 sample and 0 starts")
    target, keys = target_of(scenario, overrides, impact)
    there = moved(target, point, normal)
    with one_blas_thread():
        mapped = _Mapping(there, SelfMotion(there, hold, bounds or {}), wanted, allow_overlaps)
        configurations = [mapped.configuration(there.qpos, "run", there.qvel)] if there is target else []
        reached = mapped.samples(samples, seed, report, samples + starts)
        configurations += reached
        for i, start in enumerate(mapped.most_promising(configurations, starts)):
            configurations.append(
                mapped.configuration(mapped.optimizer.optimum(start.qpos, overlaps=allow_overlaps), "optimum")
            )
            if report is not None:
                report(samples + i + 1, samples + starts)
    return ImpactMap(there, wanted, tuple(configurations), samples, len(reached), allow_overlaps, keys)


class _Mapping:
    """What evaluates configurations of one map."""

    def __init__(self, target: Target, motion: SelfMotion, objective: Objective, allow_overlaps: bool) -> None:
        self._target, self._motion, self._objective, self._allow = target, motion, objective, allow_overlaps
        self._evaluation, self._rates, self._overlaps = Evaluation(target), ArrivalRates(motion), Overlaps(target)
        self.optimizer = Optimizer(motion, self._evaluation, self._overlaps, objective)

    def configuration(self, qpos: FloatArray, origin: Origin, qvel: FloatArray | None = None) -> Configuration:
        """A configuration that reaches the contact, with the rates at which it arrives unless they are given."""
        overlaps = self._overlaps.at(qpos)
        deepest = next(iter(overlaps), None)
        effects, jump = self._evaluation.at(qpos)
        rates = self._rates.velocities(qpos) if qvel is None else qvel
        depth, names = (overlaps[deepest], self._overlaps.names(deepest)) if deepest else (0.0, "")
        return Configuration(origin, qpos, rates, jump, effects, depth, names)

    def samples(
        self, count: int, seed: int, report: Callable[[float, float], None] | None, total: int
    ) -> list[Configuration]:
        """Configurations that reach the contact, from drawn ones.

        Raises:
            InputError: None does, or the geoms do not touch there.
        """
        configurations: list[Configuration] = []
        least, random = np.inf, np.random.default_rng(seed)
        for i in range(count):
            qpos, residual = self._motion.projected(self._motion.drawn(random))
            least = min(least, residual)
            if residual <= REACHED:
                if not configurations:
                    self._refuse_untouched(qpos)
                configurations.append(self.configuration(qpos, "sample"))
            if report is not None:
                report(i + 1, total)
        if not configurations:
            place = ", ".join(f"{x:.6g}" for x in self._target.contact.point)
            kept = {"com": " with the robot's centre of mass where it is", "base": " with the base where it is"}
            raise InputError(
                f"no configuration reaches the contact at ({place}) m{kept.get(self._motion.hold, '')}: "
                f"the nearest of {count} misses it by {least:.3g} m"
            )
        return configurations

    def most_promising(self, candidates: Sequence[Configuration], count: int) -> list[Configuration]:
        """Configurations with the best effects, from which optimisations start."""
        fair = [candidate for candidate in candidates if self._allow or candidate.overlap_m == 0.0]
        return heapq.nsmallest(count, fair or candidates, key=lambda candidate: self._objective.cost(candidate.effects))

    def _refuse_untouched(self, qpos: FloatArray) -> None:
        """Refuse a target at which the geoms do not touch: a point off the surface, or another normal.

        Raises:
            InputError: They do not.
        """
        target, data = self._target, self._target.data()
        data.qpos[:] = qpos
        mujoco.mj_forward(target.system.mj, data)
        near = target.pair.proximity(target.system.mj, data)
        angle = float(np.linalg.norm(np.cross(near.normal, target.contact.normal)))
        if abs(near.gap) > CONTACT_GAP_M or angle > _SAME_NORMAL or near.normal @ target.contact.normal < 0.0:
            raise InputError(
                f"{target.pair}: no contact with this point and normal: "
                f"the gap there is {near.gap:.3g} m, the normal of the geoms {np.round(near.normal, 6).tolist()}"
            )
