"""Free motion: rigid bodies, an arm without momentum, reaction wheels, panels on springs."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import (
    body,
    constant,
    final,
    model,
    motors,
    rock,
    run_scene,
    states,
    text_of,
    throughout,
    times,
    vector,
)

_INERTIA = (2.0, 3.0, 1.5)


def _free(inertia: tuple[float, ...]) -> str:
    return model(body("body", 1.0, inertia))


def _detest() -> Values:
    """Euler's equations are those of B5 in y_i = omega_i / s_i."""
    first, second, third = _INERTIA
    a, b, c = (second - third) / first, (first - third) / second, (second - first) / third
    scale = np.array([math.sqrt(0.51 / (b * c)), math.sqrt(0.51 / (a * c)), math.sqrt(1.0 / (a * b))])
    spin = scale * (0.0, 1.0, 1.0)
    run = run_scene(
        _free(_INERTIA), rock(), initial={"rates": {"robot/free": [0, 0, 0, *spin.tolist()]}}, **times(5e-3, 20.0)
    )
    y = final(run, "v_robot_free")[3:] / scale
    return {f"y{i + 1}": float(y[i]) for i in range(3)}


_AXIAL, _ACROSS, _SPIN, _TILT = 1.0, 2.0, 3.0, 0.5


def _precession() -> Values:
    """The axis of the body goes round the angular momentum at |L| / I_t."""
    omega = np.array([_TILT, 0.0, _SPIN])
    momentum = omega * (_ACROSS, _ACROSS, _AXIAL)
    rate = float(np.linalg.norm(momentum)) / _ACROSS
    turn_s = 2.0 * math.pi / rate
    run = run_scene(
        _free((_ACROSS, _ACROSS, _AXIAL)),
        rock(),
        initial={"rates": {"robot/free": [0, 0, 0, *omega.tolist()]}},
        **times(1e-3, round(turn_s / 4.0, 3)),
    )
    w, x, y, z = states(run, "q_robot_free")[:, 3:].T
    axis = np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    about = momentum / np.linalg.norm(momentum)
    start = axis[0] - about * (axis[0] @ about)
    across = axis[-1] - about * (axis[-1] @ about)
    angle = math.atan2(float(about @ np.cross(start, across)), float(start @ across))
    return {"rate": angle / float(run.time[-1]), "nutation": float(np.ptp(axis @ about))}


_BASE_KG, _BASE_I, _LINK_KG, _LINK_I, _HALF_M = 40.0, 3.6, 4.0, 0.1, 0.25


def _arm() -> Values:
    """A base with one joint from rest: momentum stays zero, and the base turns by what the link does."""
    joint, middle = '<joint name="joint" axis="0 0 1"/>', (_HALF_M, 0.0, 0.0)
    link = body("link", _LINK_KG, (0.1, 0.1, _LINK_I), joint=joint, at=middle, centre=middle)
    run = run_scene(
        model(body("base", _BASE_KG, (3.0, 3.0, _BASE_I), link), more=motors("joint")),
        rock(),
        phases=throughout(push=constant("joint", 0.2)),
        **times(1e-3, 3.0),
    )
    angle, rate = states(run, "q_robot_joint")[:, 0], states(run, "v_robot_joint")[:, 0]
    turning = states(run, "v_robot_free")[:, 5]
    mu = _BASE_KG * _LINK_KG / (_BASE_KG + _LINK_KG)
    whole = _BASE_I + _LINK_I + mu * (2 * _HALF_M**2 + 2 * _HALF_M**2 * np.cos(angle))
    expected = -rate * (_LINK_I + mu * (_HALF_M**2 + _HALF_M**2 * np.cos(angle))) / whole
    way = float(np.trapezoid(turning - expected, run.time))
    return {"worst": float(np.max(np.abs(turning - expected))), "turned": float(angle[-1]), "way": way}


_BUS_I, _WHEEL_I, _START, _TORQUE = 2.0, 0.01, 0.05, 0.02


def _wheel_text(axis: str, spin: float, tilt: float) -> str:
    """MJCF of a wheel of 1 kg about an axis, with its moments of inertia about it and across, kg m^2."""
    about = [axis == letter for letter in "xyz"]
    joint = f'<joint name="{axis}" axis="{vector(about)}"/>'
    return body(axis, 1.0, [spin if turns else tilt for turns in about], joint=joint)


def _wheel() -> Values:
    """A wheel takes up the spin of a bus at a constant torque."""
    run = run_scene(
        model(body("bus", 10.0, (2.0, 2.0, _BUS_I), _wheel_text("z", _WHEEL_I, 0.005)), more=motors("z")),
        rock(),
        initial={"rates": {"robot/free": [0, 0, 0, 0, 0, _START], "robot/z": 0.0}},
        phases=throughout(push=constant("z", _TORQUE)),
        **times(1e-2, _BUS_I * _START / _TORQUE),
    )
    momentum = run["momentum.robot_L_z_N_m_s"]
    return {
        "bus": float(final(run, "v_robot_free")[5]),
        "wheel": float(final(run, "v_robot_z")[0]),
        "momentum": float(np.ptp(momentum)),
    }


_TUMBLE, _TUMBLING_I = (0.1, -0.2, 0.15), (2.0, 1.5, 1.0)
_SPIN_I, _TILT_I = 0.02, 0.01
"""Moments of inertia of a wheel about its axis and across, kg m^2."""
_WHOLE_I = [tumbling + _SPIN_I + 2.0 * _TILT_I for tumbling in _TUMBLING_I]
_ALL_MOMENTUM = math.sqrt(sum((inertia * rate) ** 2 for inertia, rate in zip(_WHOLE_I, _TUMBLE, strict=True)))


def _detumbled() -> Values:
    """Three wheels damp the rate of a bus until it is at rest: they have all of the angular momentum."""
    wheels = "".join(_wheel_text(axis, _SPIN_I, _TILT_I) for axis in "xyz")
    damp = {"kind": "base_pd", "wheels": list("xyz"), "rotation": {"kp": 0.0, "kd": 1.0}}
    run = run_scene(
        model(body("bus", 10.0, _TUMBLING_I, wheels), more=motors(*"xyz")),
        rock(),
        initial={"rates": {"robot/free": [0, 0, 0, *_TUMBLE]}},
        actuators={axis: {"kind": "reaction_wheel", "max_torque_N_m": 1.0, "max_speed_rad_s": 1000.0} for axis in "xyz"},
        phases=throughout(damp=damp),
        **times(5e-2, 70.0),
    )
    w, *vector = final(run, "q_robot_free")[3:]
    stored = _SPIN_I * np.array([final(run, f"v_robot_{axis}")[0] for axis in "xyz"])
    turned = stored + 2.0 * np.cross(vector, np.cross(vector, stored) + w * stored)
    off = turned - np.array(_WHOLE_I) * _TUMBLE
    return {
        "rate": float(np.linalg.norm(final(run, "v_robot_free")[3:])),
        "stored": float(np.linalg.norm(stored)),
        "direction": float(np.linalg.norm(off)),
    }


_PRECESSION = math.hypot(_ACROSS * _TILT, _AXIAL * _SPIN) / _ACROSS
_RK4_SPIN = "RK4 at 1 ms: (h omega)^4 of 3 rad/s"
_WHEEL_RAD_S = _START + _BUS_I * _START / _WHEEL_I
_BY_RATIO = "the error of the bus, times I_b / I_w = 200"
_DETEST_WHY = "RK4 at 5 ms: 20 s (h omega)^4 / 120 of a rate of 5 rad/s"


_HUB_KG, _PANEL_KG, _ARM_M, _HINGE_M, _STIFFNESS = 750.0, 100.0, 1.5, 0.5, 100.0
_DEFLECTED = math.radians(5.0)
_COMMON_CENTRE, _COMMON_RATE, _HUB_SPIN = (0.1, -0.4, 0.3), (-0.2, 0.5, 0.1), (0.1, -0.1, 0.1)
_POSITION = ("-0.15832794740648992", "1.122481716747217", "-0.37975995949382907")
_ATTITUDE = ("0.06170318243240492", "-0.07089090074412899", "0.06409500412692531")


def _panel(name: str, side: float) -> str:
    """A panel on a side of the hub; its angle is positive towards +z."""
    joint = f'<joint name="{name}" axis="0 {-side} 0" stiffness="{_STIFFNESS}"/>'
    place, centre = (side * _HINGE_M, 0.0, 1.0), (side * _ARM_M, 0.0, 0.0)
    return body(name, _PANEL_KG, (100.0, 50.0, 50.0), joint=joint, at=place, centre=centre)


def _simulated() -> Values:
    panels = _panel("right", 1.0) + _panel("left", -1.0)
    hub = body("hub", _HUB_KG, (900.0, 800.0, 600.0), panels, centre=(0.0, 0.0, 1.0))
    spin = np.array(_HUB_SPIN)
    right = np.array([_HINGE_M + _ARM_M * math.cos(_DEFLECTED), 0.0, 1.0 + _ARM_M * math.sin(_DEFLECTED)])
    left = np.array([-_HINGE_M - _ARM_M, 0.0, 1.0])
    whole = _HUB_KG + 2.0 * _PANEL_KG
    centre = (_HUB_KG * np.array([0.0, 0.0, 1.0]) + _PANEL_KG * (right + left)) / whole
    place = np.array(_COMMON_CENTRE) - centre
    rate = np.array(_COMMON_RATE) - np.cross(spin, centre)
    run = run_scene(
        model(hub),
        rock(),
        initial={
            "joints": {"robot/free": [*place.tolist(), 1.0, 0.0, 0.0, 0.0], "robot/right": _DEFLECTED},
            "rates": {"robot/free": [*rate.tolist(), *_HUB_SPIN]},
        },
        **times(1e-3, 2.5),
    )
    pose = final(run, "q_robot_free")
    attitude = pose[4:7] / (1.0 + pose[3])
    names = (f"{kind}{i}" for kind in ("position", "attitude") for i in range(3))
    return dict(zip(names, (*pose[:3].tolist(), *attitude.tolist()), strict=True))


_ASKED = "relative accuracy that the test asks for"

CASES = (
    ValidationCase(
        "detest-b5",
        "Euler's equations of a free rigid body",
        Topic.FREE_MOTION,
        Origin.PUBLISHED,
        "DETEST problem B5: Hull, Enright, Fellen & Sedgwick 1972, Comparing numerical methods for ordinary differential"
        " equations, SIAM J. Numer. Anal. 9(4):603-637; reference solution at t = 20 as distributed with the test set"
        " (Enright & Pryce 1987, Two FORTRAN packages for assessing initial value methods, ACM TOMS 13(1):1-27)",
        "A free body of inertia (2, 3, 1.5) kg m^2 in MuJoCo, scaled to y' = (y2 y3, -y1 y3, -0.51 y1 y2), y(0) = (0,"
        " 1, 1); RK4 at 5 ms.",
        (
            Number("y1", "y1(20)", "-0.9396570798729192", 1e-8, _DETEST_WHY),
            Number("y2", "y2(20)", "-0.3421177754000779", 1e-8, _DETEST_WHY),
            Number("y3", "y3(20)", "0.7414126596199957", 1e-8, _DETEST_WHY),
        ),
        _detest,
    ),
    ValidationCase(
        "precession",
        "Precession of an axisymmetric body",
        Topic.FREE_MOTION,
        Origin.CLOSED_FORM,
        "Rate |L| / I_t about the angular momentum, constant nutation; Poinsot 1834; Goldstein, Classical Mechanics, 5.6",
        "I = (2, 2, 1) kg m^2, omega = (0.5, 0, 3) rad/s; RK4 at 1 ms over a quarter of a turn.",
        (
            Number("rate", "rate of precession, rad/s", text_of(_PRECESSION), 1e-10, _RK4_SPIN),
            Number("nutation", "change of the cosine of the nutation", "0", 1e-11, _RK4_SPIN),
        ),
        _precession,
    ),
    ValidationCase(
        "zero-momentum-arm",
        "A base turns against its arm",
        Topic.FREE_MOTION,
        Origin.CLOSED_FORM,
        "Zero angular momentum of two bodies; Umetani & Yoshida 1989, Resolved motion rate control of space"
        " manipulators with generalized Jacobian matrix, IEEE Trans. Robotics and Automation 5(3):303-314",
        "Base 40 kg, 3.6 kg m^2; link 4 kg, 0.1 kg m^2, joint and centre 0.25 m away; 0.2 N m for 3 s.",
        (
            Number(
                "worst", "largest difference of the base's rate from that of the joint's, rad/s", "0", 1e-11, "RK4 at 1 ms"
            ),
            Number("way", "its integral, rad", "0", 1e-11, "RK4 at 1 ms"),
        ),
        _arm,
    ),
    ValidationCase(
        "wheel-dumping",
        "A reaction wheel takes up the spin of a bus",
        Topic.FREE_MOTION,
        Origin.CLOSED_FORM,
        "I_b d(omega)/dt = -tau, angular momentum of the whole constant; Wertz (ed.) 1978, Spacecraft Attitude"
        " Determination and Control, 18",
        "Bus 2 kg m^2 at 0.05 rad/s, wheel 0.01 kg m^2, 0.02 N m for 5 s.",
        (
            Number("bus", "rate of the bus, rad/s", "0", 1e-9, "the spring that stands for the torque yields by 1e-9"),
            Number("wheel", "rate of the wheel relative to the bus, rad/s", text_of(_WHEEL_RAD_S), 1e-7, _BY_RATIO),
            Number("momentum", "change of the angular momentum, N m s", "0", 1e-14, "rounding of 0.1 N m s"),
        ),
        _wheel,
    ),
    ValidationCase(
        "wheels-detumble",
        "Three reaction wheels stop a tumbling bus",
        Topic.FREE_MOTION,
        Origin.CLOSED_FORM,
        "Angular momentum of the whole is constant: at rest the wheels have all of it, I_w omega_w = R^T L; Wertz (ed.)"
        " 1978, Spacecraft Attitude Determination and Control, 18",
        "Bus of (2, 1.5, 1) kg m^2 at (0.1, -0.2, 0.15) rad/s, wheels of 0.02 kg m^2, torque against the rate by `base_pd`,"
        " 1 N m s; 70 s, RK4 and control at 50 ms.",
        (
            Number("rate", "rate of the bus after, rad/s", "0", 1e-12, "exp(-kd t / I) of 0.25 rad/s is 1e-15"),
            Number(
                "stored", "momentum of the wheels, N m s", text_of(_ALL_MOMENTUM), 1e-10, "RK4 at 50 ms: (h omega)^4 / 120"
            ),
            Number("direction", "distance of R I_w omega_w from L, N m s", "0", 1e-9, "attitude by RK4 at 50 ms"),
        ),
        _detumbled,
    ),
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
                Number(f"position{i}", f"origin of the hub, {'xyz'[i]}, m", text, 1e-10, _ASKED)
                for i, text in enumerate(_POSITION)
            ),
            *(Number(f"attitude{i}", f"attitude, MRP {i + 1}", text, 1e-11, _ASKED) for i, text in enumerate(_ATTITUDE)),
        ),
        _simulated,
    ),
)
