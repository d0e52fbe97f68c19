"""Detumbling by taps of two arms: the spring and damper of a published simulation mapped to a restitution."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import body, model, rule, run_scene, slides, text_of, times, touching

_CONTACTS = ((1000, 8), (1000, 20), (9000, 8), (9000, 20))
"""Stiffness in N/m and damping in N s/m of their tables."""
_TARGET_KG, _TARGET_KG_M2, _TARGET_M = 4.45, 0.0172, 0.15
_LEVER_M = 0.8 * _TARGET_M / 2.0
_EFFECTIVE_KG = 1.0 / (1.0 / _TARGET_KG + _LEVER_M**2 / _TARGET_KG_M2)
_TAPS = 3


def _damping_ratio(stiffness: float, damping: float) -> float:
    return damping / (2.0 * math.sqrt(stiffness * _EFFECTIVE_KG))


def restitution(stiffness: float, damping: float) -> float:
    """Restitution of a linear spring and damper whose force is never negative."""
    return math.exp(
        -_damping_ratio(stiffness, damping) * math.sqrt(stiffness / _EFFECTIVE_KG) * contact_s(stiffness, damping)
    )


def contact_s(stiffness: float, damping: float) -> float:
    """Duration of the contact, s."""
    zeta = _damping_ratio(stiffness, damping)
    s = math.sqrt(1.0 - zeta * zeta)
    return 2.0 * math.atan2(s, zeta) / (s * math.sqrt(stiffness / _EFFECTIVE_KG))


def _follow(e: float) -> list[float]:
    """Spin over the first one after each tap, if the arms follow the target between taps."""
    left = 1.0 - (1.0 + e) * _LEVER_M**2 * _EFFECTIVE_KG / _TARGET_KG_M2
    return [left ** (k + 1) for k in range(_TAPS)]


def _share_with_fixed_arms(e: float) -> float:
    """Spin over the first one after a tap by each arm, if the second waits for the target in its place."""
    impulse = (1.0 + e) * _EFFECTIVE_KG * _LEVER_M
    left, speed = 1.0 - impulse * _LEVER_M / _TARGET_KG_M2, impulse / _TARGET_KG
    return left - (1.0 + e) * _EFFECTIVE_KG * (left * _LEVER_M + speed) * _LEVER_M / _TARGET_KG_M2


def _tapped(e: float, spin: float) -> Run:
    """Run of the spinning target between two fixed tips, at 0.8 of its half side and 1e-7 m from its faces."""
    radius = 0.01
    away = _TARGET_M / 2.0 + radius + 1e-7
    tips = {
        name: model(f'<geom name="tip" type="sphere" size="{radius}" pos="{side * _LEVER_M!r} {-side * away!r} 0"/>')
        for name, side in (("right", 1.0), ("left", -1.0))
    }
    joints = slides("xy") + '<joint name="yaw" axis="0 0 1"/>'
    cube = 'type="box" size="0.075 0.075 0.075"'
    return run_scene(
        model(body("target", _TARGET_KG, [_TARGET_KG_M2] * 3, joint=joints, at=(0.0, -5e-8, 0.0), geom=cube)),
        tips,
        initial={"rates": {"robot/yaw": -spin}},
        contacts=touching(*(rule("target", f"{name}/tip", e) for name in tips)),
        **times(1e-4, 1e-3),
    )


def _values() -> Values:
    values = {}
    for stiffness, damping in _CONTACTS:
        e, spin, key = restitution(stiffness, damping), 1.0, f"{stiffness}_{damping}"
        for k in range(_TAPS):
            after = [-float(np.ravel(hit.qvel_after["robot/yaw"])[0]) for hit in _tapped(e, spin).impacts]
            spin = after[0]
            values[f"follow_{key}_{k}"] = spin
            if k == 0:
                values[f"held_{key}"] = after[1]
    return values


def _numbers() -> tuple[Number, ...]:
    why = "gaps of 1e-7 m: the target turns by some 2 urad until a tip touches it"
    numbers = []
    for stiffness, damping in _CONTACTS:
        e, key = restitution(stiffness, damping), f"{stiffness}_{damping}"
        numbers += [
            Number(f"follow_{key}_{k}", f"e = {e:.4f}: share of the spin after tap {k + 1}", text_of(left, 6), 1e-5, why)
            for k, left in enumerate(_follow(e))
        ]
        numbers.append(
            Number(
                f"held_{key}",
                f"e = {e:.4f}, held arms: share of the spin after two",
                text_of(_share_with_fixed_arms(e), 6),
                1e-5,
                why,
            )
        )
    return tuple(numbers)


_MAPPED = ", ".join(f"{restitution(k, d):.4f} ({k} N/m, {d} N s/m)" for k, d in _CONTACTS)
_LONGEST_S, _SHORTEST_S = (pick(contact_s(*contact) for contact in _CONTACTS) for pick in (max, min))

CASES = (
    ValidationCase(
        "tohoku-taps",
        "Detumbling by taps of two arms in turn",
        Topic.IMPACTS,
        Origin.CLOSED_FORM,
        "Parameters: Uchida, Uno & Yoshida 2024, Space debris reliable capturing by a dual-arm orbital robot: detumbling and"
        " caging, arXiv 2405.00943, tables 4.1 and 4.2 of its public code"
        " (Space-Robotics-Laboratory/MATLAB_space_debri_capturing_sim, commit 5a65450); restitution of a spring and"
        " damper with F >= 0: e = exp(-2 zeta / s atan2(s, zeta)), s^2 = 1 - zeta^2; then conservation of both momenta"
        " at each tap",
        f"Their contacts give e = {_MAPPED}. Target of 4.45 kg and 0.0172 kg m^2, tips at 0.8 of its half side, no"
        " friction. Each tap begins with the spin that the last one left and with an arm that has followed the target"
        f" ({_TAPS} runs); and two taps in one run by arms that are held in place, the second of which meets the recoil"
        " of the first and reverses the spin.",
        _numbers(),
        _values,
        "Where a rigid contact is no model of theirs: by their spring and damper a contact lasts"
        f" {1e3 * _SHORTEST_S:.0f} to {1e3 * _LONGEST_S:.0f} ms. At their spins of 1 to 4 rad/s the target turns by"
        f" {_SHORTEST_S:.2f} to {4.0 * _LONGEST_S:.2f} rad meanwhile, and their arms, under impedance control, yield. At"
        " 9000 N/m and 1 rad/s a restitution describes the tap; at 1000 N/m and 4 rad/s it does not. Their time"
        " histories are not printed as numbers, so the sequence is compared with the formula; their arms, control and"
        " friction (mu = 0.3) are left out.",
    ),
)
