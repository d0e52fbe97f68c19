"""Joint limits of a scenario, from the ranges in its models, validated against the initial state.

Of joints that an equality constraint couples, two ends may be one stop: the tighter one is kept. Both fingers of a gripper
that are coupled reach their limits at one instant, with rows that depend on each other: the split of the force would not be
determined. The range of a joint that follows is mapped to the one that leads.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ffsm_mj.contact.joint_limit import JointLimit, Side, TendonLimit
from ffsm_mj.dynamics.loops.couplings import JointCoupling, Polynomial
from ffsm_mj.dynamics.loops.equalities import equalities_of
from ffsm_mj.errors import Faults
from ffsm_mj.model.system import System
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.tolerances import CONTACT_GAP_M

_TIE = 1e-12
"""Ends within this, rad or m, are one: that of the joint which leads is kept."""

End = tuple[int, str]
"""An end of a range: id of the joint, and ``lower`` or ``upper``."""


class _Ends(NamedTuple):
    """Ends of the range of a joint, its own or mapped ones: values, and the limits whose ends they are, None without one."""

    values: tuple[float, float]
    owners: tuple[End | None, End | None]


def redundant_ends(model: Any) -> frozenset[End]:
    """Ends of ranges that another limit of a coupled joint implies.

    A polynomial that is not monotone on the range of the joint which leads maps no ends: all are kept.

    Args:
        model: MuJoCo model of the system.
    """
    joints = np.flatnonzero(model.jnt_limited).tolist()
    ends = {
        joint: _Ends((float(low), float(high)), ((joint, "lower"), (joint, "upper")))
        for joint, (low, high) in zip(joints, model.jnt_range[joints], strict=True)
    }
    dropped = set[End]()
    for coupling in _followers_first([equality.source for equality in equalities_of(model)]):
        follower = int(model.dof_jntid[coupling.follower])
        of_follower = ends.pop(follower, None)
        if of_follower is None:
            continue
        if coupling.leader is None:
            dropped |= {owner for owner in of_follower.owners if owner is not None}
            continue
        leader = int(model.dof_jntid[coupling.leader])
        of_leader = ends.get(leader, _Ends((-math.inf, math.inf), (None, None)))
        merged = _merged(coupling.law, of_leader, of_follower)
        if merged is not None:
            before = {*of_leader.owners, *of_follower.owners}
            ends[leader] = merged
            dropped |= {owner for owner in before - {*merged.owners} if owner is not None}
    return frozenset(dropped)


def _followers_first(sources: Sequence[Any]) -> list[JointCoupling]:
    """Couplings of joints, each after those by which its follower leads other joints; of a circle, in the given order."""
    left, ordered = [source for source in sources if isinstance(source, JointCoupling)], list[JointCoupling]()
    while left:
        leading = {coupling.leader for coupling in left}
        ready = next((coupling for coupling in left if coupling.follower not in leading), left[0])
        left.remove(ready)
        ordered.append(ready)
    return ordered


def _merged(law: Polynomial, leader: _Ends, follower: _Ends) -> _Ends | None:
    """Tighter ends of both ranges in the coordinate that leads; None if the law is not monotone there."""
    slopes = np.polynomial.Polynomial(law.coefficients).deriv()
    low, high = (value - law.leader_zero for value in leader.values)
    roots = [float(root.real) for root in slopes.roots().astype(complex) if abs(root.imag) < _TIE]
    if any(low < root < high for root in roots) or not any(law.coefficients[1:]):
        return None
    at = law.leader_zero + (0.0 if math.isinf(low) and math.isinf(high) else _inside(low, high))
    rises = law.at(at)[1] > 0.0
    values, owners = list(leader.values), list(leader.owners)
    for side, sign in ((0, 1.0), (1, -1.0)):
        other = side if rises else 1 - side
        mapped = _inverse(law, leader.values, follower.values[other], rises=rises)
        if sign * (mapped - leader.values[side]) > _TIE:
            values[side], owners[side] = mapped, follower.owners[other]
    return _Ends((values[0], values[1]), (owners[0], owners[1]))


def _inside(low: float, high: float) -> float:
    """A place between two ends, of which one may be infinite."""
    if math.isinf(low):
        return high - 1.0
    return low + 1.0 if math.isinf(high) else 0.5 * (low + high)


def _inverse(law: Polynomial, between: tuple[float, float], value: float, *, rises: bool) -> float:
    """Leading coordinate at which the other one has a value, by bisection; the end of its range, if it is beyond."""
    low, high = between
    if not any(law.coefficients[2:]):
        return law.leader_zero + (value - law.follower_zero - law.coefficients[0]) / law.coefficients[1]
    low, high = max(low, -1e10), min(high, 1e10)
    for _ in range(200):
        middle = 0.5 * (low + high)
        if (law.at(middle)[0] < value) == rises:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


_SIDES: tuple[Side, ...] = ("lower", "upper")


def joint_limits(scenario: ScenarioConfig, system: System) -> tuple[JointLimit, ...]:
    """Both ends of the range of every limited joint, of coupled joints the tighter ones, then those of limited tendons.

    Models whose limits are ignored are compiled without them.

    Raises:
        ScenarioFaults: ``joint_limits`` names an unknown joint, one without limits, or one joint twice.
    """
    restitution: dict[str, float] = {}
    with Faults() as faults:
        for name, config in scenario.joint_limits.items():
            with faults.below("joint_limits", name):
                joint, is_limited = system.limited(name)
                if not is_limited:
                    raise LookupError("the joint has no limits in its model, or they are ignored (limits: ignore)")
                if joint in restitution:
                    raise LookupError(f"the joint {joint} is listed twice")
                restitution[joint] = config.restitution
    redundant = redundant_ends(system.mj)
    limits: tuple[JointLimit, ...] = tuple(
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
    kept = {limit.joint for limit in limits}
    with Faults() as faults:
        for name in scenario.joint_limits:
            if system.limited(name)[0] not in kept:
                why = "the joint is coupled with others that reach their limits first: name one of these"
                faults.add(why, "joint_limits", name)
    return limits


def refuse_outside(scenario: ScenarioConfig, system: System, data: Any, limits: tuple[JointLimit, ...]) -> None:
    """Refuse joints that start past a limit.

    Raises:
        ScenarioFaults: There is such a joint.
    """
    keys = {system.joint(name).name: name for name in scenario.initial.joints}
    with Faults() as faults:
        for limit in (candidate for candidate in limits if candidate.gap(system.mj, data, 0.0) < -CONTACT_GAP_M):
            of_tendon, (low, high) = isinstance(limit, TendonLimit), limit.range
            message = f"{'tendon' if of_tendon else 'joint'} {limit.joint} starts at {limit.value(data):.6g} {limit.unit}"
            outside = f"{message}, outside its limits of {low:.6g} to {high:.6g} {limit.unit}"
            hint = _degrees_hint(limit.value(data), low, high) if limit.unit == "rad" and not of_tendon else ""
            faults.add(outside + hint, "initial", *(("joints", keys[limit.joint]) if limit.joint in keys else ()))


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
