"""Joint limits of a scenario, from the ranges in its models, validated against the initial state."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ffsm_mj.assembly.coupled_limits import redundant_ends
from ffsm_mj.contact.joint_limit import JointLimit, Side, TendonLimit
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.model.system import System
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.tolerances import CONTACT_GAP_M

_SIDES: tuple[Side, ...] = ("lower", "upper")


def joint_limits(scenario: ScenarioConfig, system: System) -> tuple[JointLimit, ...]:
    """Both ends of the range of every limited joint, of coupled joints the tighter ones, then those of limited tendons.

    Models whose limits are ignored are compiled without them.

    Raises:
        ScenarioFaults: ``joint_limits`` names an unknown joint, one without limits, or one joint twice.
    """
    restitution, faults = {}, []
    for name, config in scenario.joint_limits.items():
        try:
            joint, is_limited = system.limited(name)
        except LookupError as error:
            faults.append(Fault(str(error.args[0]), ("joint_limits", name)))
            continue
        if not is_limited:
            why = "the joint has no limits in its model, or they are ignored (limits: ignore)"
            faults.append(Fault(why, ("joint_limits", name)))
        elif joint in restitution:
            faults.append(Fault(f"the joint {joint} is listed twice", ("joint_limits", name)))
        else:
            restitution[joint] = config.restitution
    redundant = redundant_ends(system.mj)
    limits = tuple(
        JointLimit(system.mj, joint, side, restitution.get(system.mj.joint(joint).name, 0.0))
        for joint in np.flatnonzero(system.mj.jnt_limited).tolist()
        for side in _SIDES
        if (joint, side) not in redundant
    )
    limits += tuple(
        TendonLimit(system.mj, tendon, side, restitution.get(system.mj.tendon(tendon).name, 0.0))
        for tendon in np.flatnonzero(system.mj.tendon_limited).tolist()
        for side in _SIDES
    )
    kept = {each.joint for each in limits}
    for name in scenario.joint_limits if not faults else ():
        if system.limited(name)[0] not in kept:
            why = "the joint is coupled with others that reach their limits first: name one of these"
            faults.append(Fault(why, ("joint_limits", name)))
    if faults:
        raise ScenarioFaults(faults)
    return limits


def refuse_outside(scenario: ScenarioConfig, system: System, data: Any, limits: tuple[JointLimit, ...]) -> None:
    """Refuse joints that start past a limit.

    Raises:
        ScenarioFaults: There is such a joint.
    """
    given = {system.joint(name).name: name for name in scenario.initial.joints}
    faults = []
    for limit in limits:
        if limit.gap(system.mj, data, 0.0) < -CONTACT_GAP_M:
            of_tendon = isinstance(limit, TendonLimit)
            low, high = limit.range
            message = f"{'tendon' if of_tendon else 'joint'} {limit.joint} starts at {limit.value(data):.6g} {limit.unit}"
            path = ("initial", "joints", given[limit.joint]) if limit.joint in given else ("initial",)
            outside = f"{message}, outside its limits of {low:.6g} to {high:.6g} {limit.unit}"
            hint = _degrees_hint(limit.value(data), low, high) if limit.unit == "rad" and not of_tendon else ""
            faults.append(Fault(f"{outside}{hint}", path))
    if faults:
        raise ScenarioFaults(faults)


def _degrees_hint(value: float, low: float, high: float) -> str:
    """What to change where an angle was probably written in the unit of the other file; empty where it was not.

    Both mistakes show only if the numbers would fit in the other unit and exceed a turn in it: a start of more than a turn
    in rad that lies within the limits as degrees, or limits that span at most two turns if their degrees were meant as rad.
    """
    turn = 2.0 * math.pi
    if abs(value) > turn and low <= math.radians(value) <= high:
        return f"; angles in a scenario are in rad, and {value:g} degrees are {math.radians(value):.6g} rad"
    stated_low, stated_high = math.degrees(low), math.degrees(high)
    if stated_high - stated_low <= 2.0 * turn and stated_low <= value <= stated_high:
        return (
            f"; if the model file states {stated_low:.6g} to {stated_high:.6g} in rad, it needs"
            ' <compiler angle="radian"/>: angles in MJCF are in degrees by default'
        )
    return ""
