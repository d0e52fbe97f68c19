"""Checks of a run that need its models: impacts with friction, the independent checks, the state at the end; log replay."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.records import GraspRecord, ReleaseRecord
from ffsm_mj.dynamics.stack_momentum import StackMomentum
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log, scenario_data
from ffsm_mj.model.system import System
from ffsm_mj.records.events import Outcome
from ffsm_mj.records.metadata import TERMINAL_UNITS, terminal_bounds
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import coordinate_keys, rate_keys
from ffsm_mj.verification.agreement import Discrepancy
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, TERMINAL_CHECKS, CheckAccumulator, Tolerance, tolerances
from ffsm_mj.verification.impact_checks import FrictionCheck, Models
from ffsm_mj.verification.independent.kept_rows import KeptRows

if TYPE_CHECKING:
    from ffsm_mj.verification.independent.finding import Finding


class ModelChecks:
    """Checks of one log with its models; these are compiled, and the checks computed, when they are first asked for."""

    def __init__(self, log: RunLog, kept: KeptRows, models: Models | None = None) -> None:
        """Bind to a log.

        Args:
            log: The log, of which metadata and records suffice.
            kept: Its kept rows.
            models: Returns its compiled models and its scenario as plain data; None: they are taken from the log.
        """
        self._log, self._kept = log, kept
        self._models = models or partial(_logged_models, log)
        self._friction = FrictionCheck(log, self._models)

    def all_checks(self, rows: CheckAccumulator, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Check, ...]:
        """Results of all checks: those of the rows and records, and those that need the models.

        Args:
            rows: Checks of the rows.
            tolerance: See :func:`ffsm_mj.verification.checks.tolerances`.

        Raises:
            KeyError: A tolerance for an unknown check.
        """
        allowed, named = tolerances(tolerance), tolerance if isinstance(tolerance, Mapping) else {}
        of_rows = rows.checks(self._log.impact_records, tolerance, self._friction)
        return (*of_rows, *self._independent(allowed), *self._terminal(rows, named))

    def _independent(self, allowed: Mapping[str, float]) -> list[Check]:
        """Checks by other physics than the engine's: see :mod:`ffsm_mj.verification.independent`."""
        return [
            Check(
                name=finding.name,
                subsystem="total",
                component=finding.component,
                residual=finding.residual,
                time_s=finding.time_s,
                tolerance=allowed[finding.name] * (1.0 + finding.scale),
                unit=finding.unit,
                drift=finding.residual,
            )
            for finding in self._findings
        ]

    @cached_property
    def _findings(self) -> list[Finding]:
        from ffsm_mj.verification.independent.findings import independent_findings

        if not self._has_anything():
            return []
        try:
            return independent_findings(self._log, self._kept, *self._models())
        except InputError:  # the log has no models, or they no longer compile
            return []

    def _terminal(self, rows: CheckAccumulator, named: Mapping[str, float]) -> list[Check]:
        """Checks of the last state; none where the scenario asks for none, or if the run did not reach its end."""
        bounds, outcome = terminal_bounds(self._log.header.metadata), self._log.outcome
        if not bounds or outcome is None or outcome.outcome != Outcome.COMPLETED:
            return []
        end_s = math.nan if rows.last is None else float(rows.last[rows.layout.time])
        left = dict(zip(TERMINAL_CHECKS, self._left(rows), strict=True))
        return [
            Check(name, "robot", component, left[key], end_s, named.get(name, bounds[key]), TERMINAL_UNITS[key], left[key])
            for key, (name, component) in TERMINAL_CHECKS.items()
            if key in bounds
        ]

    def _left(self, rows: CheckAccumulator) -> tuple[float, float, float, float]:
        """What is left in the last row, in the order of ``TERMINAL_CHECKS``; NaN if it is unknown.

        It is |L| of robot and grasped object about their centre of mass, less that of the wheels, angular speed and speed of
        the base, and the greatest angular speed of an object relative to it.
        """
        unknown = (math.nan,) * 4
        if rows.last is None:
            return unknown
        try:
            system, _ = self._models()
            joints, data = system.joints.values(), mujoco.MjData(system.mj)
            data.qpos[:] = rows.last[rows.layout.places(coordinate_keys(joints))]
            data.qvel[:] = rows.last[rows.layout.places(rate_keys(joints))]
        except (InputError, KeyError):
            return unknown
        mujoco.mj_kinematics(system.mj, data)
        mujoco.mj_comPos(system.mj, data)
        mujoco.mj_comVel(system.mj, data)
        grasped = grasped_objects(self._log.events)
        rest, _ = StackMomentum(system).parts(data, grasped)
        base = _twist(system, data, system.robot.root)
        objects = [_twist(system, data, one.root) for one in system.objects if not grasped or one.name in grasped]
        relative = max((math.dist(one[:3], base[:3]) for one in objects), default=0.0)
        return math.hypot(*rest.tolist()), math.hypot(*base[:3]), math.hypot(*base[3:]), relative

    def _has_anything(self) -> bool:
        """Whether there is anything to check so; models are not compiled for nothing."""
        columns = ("sensor.", "contact.grasp_", "balance.friction_heat")
        return bool(self._log.impact_records) or any(key.startswith(columns) for key in self._kept.layout.keys)


def _logged_models(log: RunLog) -> tuple[System, Mapping[str, Any]]:
    """The models in a log, compiled, and its scenario.

    Raises:
        InputError: It has none, or they do not compile.
    """
    return compile_log(log), scenario_data(log)


def _twist(system: System, data: Any, body: int) -> FloatArray:
    """Angular velocity and velocity of a body's frame in world axes, (6,)."""
    twist = np.empty(6)
    mujoco.mj_objectVelocity(system.mj, data, mujoco.mjtObj.mjOBJ_XBODY, body, twist, 0)
    return twist


def grasped_objects(events: Iterable[Any]) -> tuple[str, ...]:
    """Names of the objects that are grasped after some events, in order."""
    objects: dict[str, str] = {}
    for event in events:
        if isinstance(event, GraspRecord):
            objects.pop(event.replaces, None)
            objects[event.grasp] = event.object_site.partition("/")[0]
        elif isinstance(event, ReleaseRecord):
            objects.pop(event.grasp, None)
    return tuple(dict.fromkeys(objects.values()))  # two grasps may hold one object


@dataclass(frozen=True)
class ReplayResult:
    """Result of the replay of a log from its states.

    Attributes:
        worst: Worst difference between the log and its states in ``motion``, ``columns`` and ``impacts``.
        samples: Number of recomputed samples.
        numbers: Number of compared values.
        gaps: Where samples are not one control period apart; empty if all are.
        obstacle: Why the log could not be replayed; empty if it was.
        accumulator: Checks from the recomputed values.
        verified_to_s: Time from which a damaged log does not say enough to be replayed, s; infinite if all of it was.
    """

    worst: Mapping[str, Discrepancy]
    samples: int
    numbers: int
    gaps: str
    obstacle: str
    accumulator: CheckAccumulator
    _log: RunLog
    _models: ModelChecks
    verified_to_s: float = math.inf

    @property
    def agrees(self) -> bool:
        """Whether the log agrees with its states; False if it could not be replayed."""
        return not self.obstacle and all(difference.passes for difference in self.worst.values())

    def checks(self, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Check, ...]:
        """All checks from the recomputed values, or from the logged values if the log could not be replayed.

        Args:
            tolerance: See :func:`ffsm_mj.verification.checks.tolerances`.
        """
        checks = self._models.all_checks(self.accumulator, tolerance)
        # If what the log says of itself may be damaged, a check that fails says nothing of the run.
        return tuple(check for check in checks if check.passes) if self._log.is_doubtful else checks
