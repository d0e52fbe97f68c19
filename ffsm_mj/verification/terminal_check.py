"""Checks of the state at the end of a run, those that its scenario asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import mujoco

from ffsm_mj.contact_models.grasp.records import GraspRecord, ReleaseRecord
from ffsm_mj.dynamics.stack_momentum import StackMomentum
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.records.events import Outcome
from ffsm_mj.records.metadata import terminal_stack_momentum
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import coordinate_keys, rate_keys
from ffsm_mj.verification.check_result import Check

STACK_MOMENTUM = "stack momentum at the end"
"""Name of the check that robot and grasped object have no angular momentum except in the wheels."""


def terminal_checks(
    log: RunLog, tolerances: Mapping[str, float], known: Callable[[], float] | None = None
) -> tuple[Check, ...]:
    """Checks of the last state; empty where the scenario asks for none, and for a run that did not reach its end.

    Args:
        log: A run.
        tolerances: Given tolerances by check, in place of that of the scenario.
        known: Returns the angular momentum that is left, N m s; None: it is computed from the last row of the log.
    """
    bound = terminal_stack_momentum(log.header.metadata)
    if bound is None or log.outcome is None or log.outcome.outcome != Outcome.COMPLETED:
        return ()
    found = _stack_momentum(log) if known is None else known()
    end_s = float(log.rows[-1][log.header.layout.time]) if len(log.rows) else math.nan
    allowed = tolerances.get(STACK_MOMENTUM, bound)
    return (Check(STACK_MOMENTUM, "robot", "L", found, end_s, allowed, "N m s", found),)


def _stack_momentum(log: RunLog) -> float:
    """|L| of robot and grasped object about their centre of mass, less that of the wheels; NaN if it is unknown."""
    if not len(log.rows):
        return math.nan
    try:
        system = compile_log(log)
        joints, row = system.joints.values(), log.rows[-1]
        data = mujoco.MjData(system.mj)
        data.qpos[:] = row[log.header.layout.places(coordinate_keys(joints))]
        data.qvel[:] = row[log.header.layout.places(rate_keys(joints))]
    except (InputError, KeyError):
        return math.nan
    mujoco.mj_kinematics(system.mj, data)
    mujoco.mj_comPos(system.mj, data)
    rest, _ = StackMomentum(system).parts(data, grasped_objects(log.events()))
    return math.hypot(*rest.tolist())


def grasped_objects(events: Iterable[Any]) -> tuple[str, ...]:
    """Names of the objects that are grasped after some events, in order."""
    held: dict[str, str] = {}
    for event in events:
        if isinstance(event, GraspRecord):
            held.pop(event.replaces, None)
            held[event.grasp] = event.object_site.partition("/")[0]
        elif isinstance(event, ReleaseRecord):
            held.pop(event.grasp, None)
    return tuple(dict.fromkeys(held.values()))  # two grasps may hold one object
