"""Free motion: rigid bodies, an arm without momentum, a reaction wheel."""

from __future__ import annotations

import math

import numpy as np

from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import final, model, run_scene, states, text_of, times

_INERTIA = (2.0, 3.0, 1.5)
_FAR = 1e12


def _free(inertia: tuple[float, ...]) -> str:
    return f"""<body name="body"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{" ".join(map(str, inertia))}"/>
      <geom name="body" type="sphere" size="0.1" mass="0"/></body>"""


def _rock() -> dict[str, str]:
    """A free object far away: a scene has one."""
    return {"rock": model(_free((1.0, 1.0, 1.0)).replace('name="body"', 'name="rock" pos="90 0 0"', 1))}


def _detest() -> Values:
    """Euler's equations are those of B5 in y_i = omega_i / s_i."""
    first, second, third = _INERTIA
    a, b, c = (second - third) / first, (first - third) / second, (second - first) / third
    scale = np.array([math.sqrt(0.51 / (b * c)), math.sqrt(0.51 / (a * c)), math.sqrt(1.0 / (a * b))])
    spin = scale * (0.0, 1.0, 1.0)
    run = run_scene(
        model(_free(_INERTIA)), _rock(), initial={"rates": {"robot/free": [0, 0, 0, *spin.tolist()]}}, **times(5e-3, 20.0)
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
        model(_free((_ACROSS, _ACROSS, _AXIAL))),
        _rock(),
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
    link = f"""<body name="base"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="{_BASE_KG}" diaginertia="3 3 {_BASE_I}"/>
      <geom name="base" size="0.01" mass="0"/>
      <body name="link" pos="{_HALF_M} 0 0"><joint name="joint" axis="0 0 1"/>
        <inertial pos="{_HALF_M} 0 0" mass="{_LINK_KG}" diaginertia="0.1 0.1 {_LINK_I}"/>
        <geom name="link" size="0.01" mass="0"/></body></body>"""
    push = {"kind": "pd", "joints": ["joint"], "kp": 0.2 / _FAR, "kd": 0.0, "target": [_FAR]}
    run = run_scene(
        model(link, more='<actuator><motor name="joint" joint="joint"/></actuator>'),
        _rock(),
        phases=[{"name": "push", "until": "end", "controller": push}],
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


def _wheel() -> Values:
    """A wheel takes up the spin of a bus at a constant torque."""
    bus = f"""<body name="bus"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="10" diaginertia="2 2 {_BUS_I}"/>
      <geom name="bus" size="0.1" mass="0"/><body name="wheel"><joint name="wheel" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="0.005 0.005 {_WHEEL_I}"/>
        <geom name="wheel" size="0.05" mass="0"/></body></body>"""
    push = {"kind": "pd", "joints": ["wheel"], "kp": _TORQUE / _FAR, "kd": 0.0, "target": [_FAR]}
    run = run_scene(
        model(bus, more='<actuator><motor name="wheel" joint="wheel"/></actuator>'),
        _rock(),
        initial={"rates": {"robot/free": [0, 0, 0, 0, 0, _START], "robot/wheel": 0.0}},
        phases=[{"name": "dump", "until": "end", "controller": push}],
        **times(1e-2, _BUS_I * _START / _TORQUE),
    )
    momentum = run["momentum.robot_L_z_N_m_s"]
    return {
        "bus": float(final(run, "v_robot_free")[5]),
        "wheel": float(final(run, "v_robot_wheel")[0]),
        "momentum": float(np.ptp(momentum)),
    }


_TUMBLE, _TUMBLING_I = (0.1, -0.2, 0.15), (2.0, 1.5, 1.0)
_SPIN_I, _TILT_I = 0.02, 0.01
"""Moments of inertia of a wheel about its axis and across, kg m^2."""
_WHOLE_I = [each + _SPIN_I + 2.0 * _TILT_I for each in _TUMBLING_I]
_ALL_MOMENTUM = math.sqrt(sum((inertia * rate) ** 2 for inertia, rate in zip(_WHOLE_I, _TUMBLE, strict=True)))


def _detumbled() -> Values:
    """Three wheels damp the rate of a bus until it is at rest: they have all of the angular momentum."""
    wheels = ""
    for i, axis in enumerate("xyz"):
        inertia = " ".join(str(_SPIN_I if k == i else _TILT_I) for k in range(3))
        wheels += f"""<body name="{axis}"><joint name="{axis}" axis="{" ".join(str(int(k == i)) for k in range(3))}"/>
          <inertial pos="0 0 0" mass="1" diaginertia="{inertia}"/><geom name="{axis}" size="0.05" mass="0"/></body>"""
    bus = f"""<body name="bus"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="10" diaginertia="{" ".join(map(str, _TUMBLING_I))}"/>
      <geom name="bus" size="0.1" mass="0"/>{wheels}</body>"""
    motors = "".join(f'<motor name="{axis}" joint="{axis}"/>' for axis in "xyz")
    damp = {"kind": "base_pd", "wheels": list("xyz"), "rotation": {"kp": 0.0, "kd": 1.0}}
    run = run_scene(
        model(bus, more=f"<actuator>{motors}</actuator>"),
        _rock(),
        initial={"rates": {"robot/free": [0, 0, 0, *_TUMBLE]}},
        actuators={axis: {"kind": "reaction_wheel", "max_torque_N_m": 1.0, "max_speed_rad_s": 1000.0} for axis in "xyz"},
        phases=[{"name": "damp", "until": "end", "controller": damp}],
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


_DETEST_WHY = "RK4 at 5 ms: 20 s (h omega)^4 / 120 of a rate of 5 rad/s"

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
            Number(
                "rate",
                "rate of precession, rad/s",
                text_of(math.hypot(_ACROSS * _TILT, _AXIAL * _SPIN) / _ACROSS),
                1e-10,
                "RK4 at 1 ms: (h omega)^4 of 3 rad/s",
            ),
            Number("nutation", "change of the cosine of the nutation", "0", 1e-11, "RK4 at 1 ms: (h omega)^4 of 3 rad/s"),
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
            Number(
                "wheel",
                "rate of the wheel relative to the bus, rad/s",
                text_of(_START + _BUS_I * _START / _WHEEL_I),
                1e-7,
                "the error of the bus, times I_b / I_w = 200",
            ),
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
)
