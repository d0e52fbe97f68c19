"""Removal of non-conservative and ineffective elements from a vendor's model before it is compiled.

The files are not changed; a run, a log replay and a rerun remove the same elements.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal, get_args

import mujoco

from ffsm_mj.model.actuators import is_plain_motor

Strippable = Literal[
    "damping", "frictionloss", "stiffness", "limits", "equalities", "tendons", "servos", "gravcomp", "sensors"
]
STRIPPABLE: tuple[str, ...] = get_args(Strippable)
LimitsMode = Literal["stop", "ignore"]
"""``stop``: a joint cannot move past the limits of its model; ``ignore``: they are removed."""
_SHOWN = 6


def to_strip(words: Iterable[str] | None, limits: str | None) -> tuple[str, ...]:
    """Elements to remove from a model by the keys ``strip`` and ``limits`` of a scenario; None: not given."""
    given = tuple(words or ())
    return (*given, "limits") if limits == "ignore" and "limits" not in given else given


def strip(spec: Any, what: Iterable[str]) -> list[str]:
    """Remove elements from a specification before it is compiled.

    Args:
        spec: Specification of the model; all its elements have names.
        what: ``damping``, ``frictionloss`` and ``stiffness`` of joints, tendons and actuators (a ``springdamper`` goes with
            either of its two), ``limits`` of joints and tendons, ``equalities``, ``tendons`` with the actuators, sensors and
            equalities that need them, ``servos``: the actuators that are no plain motors, with the sensors that need them,
            and ``gravcomp`` of bodies, and ``sensors``.

    Returns:
        A phrase for each kind of removed element, such as ``damping of 2 joints (elbow, wrist)``.
    """
    wanted, removed = set(what), []
    for word in STRIPPABLE:
        if word not in wanted:
            continue
        if word == "equalities":
            removed += _deleted(spec, "equality constraint", list(spec.equalities))
        elif word == "sensors":
            removed += _deleted(spec, "sensor", list(spec.sensors))
        elif word == "tendons":
            removed += _without_tendons(spec)
        elif word == "gravcomp":
            names = [body.name for body in spec.bodies if _clear_gravcomp(body)]
            removed += [f"gravcomp of {_counted('link', names)}"] if names else []
        elif word == "servos":
            removed += _without_actuators(spec, [each for each in spec.actuators if not is_plain_motor(each)])
        else:
            actuators = spec.actuators if word == "damping" else ()
            for noun, elements in (("joint", spec.joints), ("tendon", spec.tendons), ("actuator", actuators)):
                names = [element.name for element in elements if _clear(element, word)]
                removed += [f"{word} of {_counted(noun, names)}"] if names else []
    return removed


def _clear(element: Any, word: str) -> bool:
    """Clear a property of a joint or tendon; returns whether it was set."""
    if word == "limits":
        limited = element.limited == mujoco.mjtLimited.mjLIMITED_TRUE or (
            element.limited == mujoco.mjtLimited.mjLIMITED_AUTO and bool(element.range.any())
        )
        element.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        return limited
    if word == "frictionloss":
        had, element.frictionloss = bool(element.frictionloss), 0.0
        return had
    had = bool(getattr(element, word).any())
    getattr(element, word)[:] = 0.0
    springdamper = getattr(element, "springdamper", None)
    if springdamper is not None and springdamper.any():
        springdamper[:] = 0.0
        had = True
    return had


def _clear_gravcomp(body: Any) -> bool:
    """Clear the gravity compensation of a body; returns whether it was set."""
    had, body.gravcomp = bool(body.gravcomp), 0.0
    return had


def _without_tendons(spec: Any) -> list[str]:
    tendons = list(spec.tendons)
    names = {tendon.name for tendon in tendons}
    removed = _without_sensors_of(spec, mujoco.mjtObj.mjOBJ_TENDON, names)
    pulling = [each for each in spec.actuators if each.trntype == mujoco.mjtTrn.mjTRN_TENDON and each.target in names]
    removed += _without_actuators(spec, pulling)
    equalities = [each for each in spec.equalities if each.type == mujoco.mjtEq.mjEQ_TENDON]
    return removed + _deleted(spec, "equality constraint", equalities) + _deleted(spec, "tendon", tendons)


def _without_actuators(spec: Any, actuators: list[Any]) -> list[str]:
    names = {actuator.name for actuator in actuators}
    removed = _without_sensors_of(spec, mujoco.mjtObj.mjOBJ_ACTUATOR, names)
    for key in spec.keys if actuators else ():  # keyframes have a value per actuator; they are not used here
        key.ctrl, key.act = [], []
    return removed + _deleted(spec, "actuator", actuators)


def _without_sensors_of(spec: Any, kind: Any, names: set[str]) -> list[str]:
    gone = {(int(kind), name) for name in names}
    needing = [
        each for each in spec.sensors if {(int(each.objtype), each.objname), (int(each.reftype), each.refname)} & gone
    ]
    return _deleted(spec, "sensor", needing)


def _deleted(spec: Any, noun: str, elements: list[Any]) -> list[str]:
    names = [element.name for element in elements]
    for element in elements:
        spec.delete(element)
    return [_counted(noun, names)] if names else []


def _counted(noun: str, names: list[str]) -> str:
    shown = ", ".join(name or "unnamed" for name in names[:_SHOWN])
    return f"{len(names)} {noun}{'s' if len(names) > 1 else ''} ({shown}{', ...' if len(names) > _SHOWN else ''})"
