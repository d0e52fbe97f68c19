"""Grasps that are closed at an impact by the records of a log, and the relative velocities that they stop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact_models.grasp.config import GraspConfig
from ffsm_mj.contact_models.grasp.records import GRASP, RELEASE, GraspRecord, ReleaseRecord
from ffsm_mj.log.scenario import scenario_data
from ffsm_mj.model.system import System
from ffsm_mj.records.event_order import merged
from ffsm_mj.records.load_columns import logged_load_columns
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import identifier


def closed_grasps(log: RunLog, impact: Any) -> list[str]:
    """Names of the grasps that are closed at an impact.

    Args:
        log: The log.
        impact: Record of the impact.

    Raises:
        LookupError: The scenario has fewer grasps than the log says.
        ValueError: A number in the log is none.
    """
    records = [each for kind in (GRASP, RELEASE) for each in log.records.get(kind.plural, ())]
    records.sort(key=lambda each: each.event)
    closed = [*_since_start(records), *_in_first_row(log, records)]
    for record in _before(log, records, impact):
        if isinstance(record, GraspRecord):
            closed = [each for each in closed if each != record.replaces] + [record.grasp]
        else:
            closed = [each for each in closed if each != record.grasp]
    return closed


def _since_start(records: Sequence[GraspRecord | ReleaseRecord]) -> list[str]:
    """Grasps that are closed since the start of a log: a record ends them before one begins them."""
    known: set[str] = set()
    found: list[str] = []
    for record in records:
        ended = record.replaces if isinstance(record, GraspRecord) else record.grasp
        if ended and ended not in known:
            found.append(ended)
        known |= {ended, record.grasp}
    return found


def _in_first_row(log: RunLog, records: Sequence[GraspRecord | ReleaseRecord]) -> list[str]:
    """Grasps without a record that are closed in the first row.

    Raises:
        LookupError: The scenario has fewer grasps than the log says.
        ValueError: A number in the log is none.
    """
    layout = log.header.layout
    sets = logged_load_columns(layout)
    if not sets or not len(log.rows):
        return []
    names = [*scenario_data(log)["grasps"]]
    told = {record.grasp for record in records}
    if not sets[0].grasp:
        number = 0 if told else int(log.rows[0, layout.index[sets[0].closed]])
        return [names[number - 1]] if number > 0 else []
    closed = {each.grasp for each in sets if log.rows[0, layout.index[each.closed]] > 0.0}
    return [name for name in names if identifier(name) in closed and name not in told]


def stopped_rows(log: RunLog, models: tuple[System, Any], grasp: str) -> FloatArray:
    """Rows of the relative velocities that a closed grasp stops, (n, nv).

    Args:
        log: The log.
        models: System of the log and its data, at the state of the impact.
        grasp: Name of the grasp.

    Raises:
        LookupError: The scenario has no such grasp, or the models have no such site.
        ValueError: Its configuration is not of this version.
    """
    from ffsm_mj.contact_models.grasp.latch_joints import relative_twist_rows, stopped_components

    (system, data), config = models, GraspConfig.model_validate(scenario_data(log)["grasps"][grasp])
    robot, of_object = (system.index("site", name) for name in (config.robot_site, config.object_site))
    link, root = (int(system.mj.site_bodyid[site]) for site in (robot, of_object))
    rows = relative_twist_rows(system.mj, data, link, root, data.site_xpos[of_object].copy())
    joint = config.latch_joint
    axis = data.site_xmat[robot].reshape(3, 3) @ (joint.axis or np.zeros(3))
    return stopped_components(joint.kind, axis) @ rows


def _before(log: RunLog, grasps: Sequence[GraspRecord | ReleaseRecord], impact: Any) -> list[Any]:
    """Captures and releases before an impact, in their order."""
    place = impact.step, impact.time_s
    earlier = [each for each in grasps if (each.step, each.time_s) < place]
    at_once: list[Any] = [each for each in grasps if (each.step, each.time_s) == place]
    if not at_once:
        return earlier
    impacts = {each.event: each for each in log.impact_records if (each.step, each.time_s) == place}
    order = merged([impacts[event] for event in sorted(impacts)], at_once, _jump)
    until = next(i for i, each in enumerate(order) if each is impacts[impact.event])
    return [*earlier, *(each for each in order[:until] if each in at_once)]


def _jump(event: Any, after: Any) -> float:
    """Distance between the velocities after one event and those before another."""
    return _apart(event.qvel_after, after.qvel_before)


def _apart(rates: Mapping[str, Any], others: Mapping[str, Any]) -> float:
    """Distance between two sets of velocities by joint."""
    return float(np.linalg.norm(np.concatenate([np.subtract(rate, others[joint]) for joint, rate in rates.items()])))
