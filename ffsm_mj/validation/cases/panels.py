"""Basilisk's hub with two hinged panels on springs."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import ball, final, model, run_scene, times

_HUB_KG, _PANEL_KG, _ARM_M, _HINGE_M, _STIFFNESS = 750.0, 100.0, 1.5, 0.5, 100.0
_DEFLECTED = math.radians(5.0)
_CENTRE, _CENTRE_RATE, _SPIN = (0.1, -0.4, 0.3), (-0.2, 0.5, 0.1), (0.1, -0.1, 0.1)
_POSITION = ("-0.15832794740648992", "1.122481716747217", "-0.37975995949382907")
_ATTITUDE = ("0.06170318243240492", "-0.07089090074412899", "0.06409500412692531")


def _panel(name: str, side: float) -> str:
    """A panel on a side of the hub; its angle is positive towards +z."""
    return f"""<body name="{name}" pos="{side * _HINGE_M} 0 1">
      <joint name="{name}" axis="0 {-side} 0" stiffness="{_STIFFNESS}"/>
      <inertial pos="{side * _ARM_M} 0 0" mass="{_PANEL_KG}" diaginertia="100 50 50"/>
      <geom name="{name}" size="0.1" mass="0"/></body>"""


def _flown() -> Values:
    hub = f"""<body name="hub"><freejoint name="free"/>
      <inertial pos="0 0 1" mass="{_HUB_KG}" diaginertia="900 800 600"/><geom name="hub" size="0.1" mass="0"/>
      {_panel("right", 1.0)}{_panel("left", -1.0)}</body>"""
    spin = np.array(_SPIN)
    right = np.array([_HINGE_M + _ARM_M * math.cos(_DEFLECTED), 0.0, 1.0 + _ARM_M * math.sin(_DEFLECTED)])
    left = np.array([-_HINGE_M - _ARM_M, 0.0, 1.0])
    whole = _HUB_KG + 2.0 * _PANEL_KG
    centre = (_HUB_KG * np.array([0.0, 0.0, 1.0]) + _PANEL_KG * (right + left)) / whole
    place = np.array(_CENTRE) - centre
    rate = np.array(_CENTRE_RATE) - np.cross(spin, centre)
    run = run_scene(
        model(hub),
        {"rock": model(ball("rock", 1.0, 0.1, at=(90, 0, 0)))},
        initial={
            "joints": {"robot/free": [*place.tolist(), 1.0, 0.0, 0.0, 0.0], "robot/right": _DEFLECTED},
            "rates": {"robot/free": [*rate.tolist(), *_SPIN]},
        },
        **times(1e-3, 2.5),
    )
    pose = final(run, "q_robot_free")
    attitude = pose[4:7] / (1.0 + pose[3])
    names = (f"{kind}{i}" for kind in ("position", "attitude") for i in range(3))
    return dict(zip(names, (*pose[:3].tolist(), *attitude.tolist()), strict=True))


_WHY = "relative accuracy that the test asks for"

CASES = (
    ValidationCase(
        "basilisk-panels",
        "Basilisk: a hub with two hinged panels on springs",
        Topic.FREE_MOTION,
        Origin.PUBLISHED,
        "Basilisk (AVSLab/basilisk), test of hingedRigidBodyStateEffector without gravity, reference values at 2.5 s;"
        " equations of Allard, Schaub & Piggott 2018, General hinged rigid-body dynamics approximating first-order"
        " spacecraft solar panel flexing, J. Spacecraft and Rockets",
        "Hub of 750 kg, panels of 100 kg on springs of 100 N m/rad, one deflected by 5 degrees; tumbling."
        " RK4 at 1 ms, as there.",
        (
            *(
                Number(f"position{i}", f"origin of the hub, {'xyz'[i]}, m", text, 1e-10, _WHY)
                for i, text in enumerate(_POSITION)
            ),
            *(Number(f"attitude{i}", f"attitude, MRP {i + 1}", text, 1e-11, _WHY) for i, text in enumerate(_ATTITUDE)),
        ),
        _flown,
    ),
)
