"""Captures: plastic impulses of two satellites, and of a mission-sized servicer."""

from __future__ import annotations

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import final, model, run_scene, text_of, times

_LATCHES = {"rigid": 6, "ball": 3, "hinge": 5, "cylindrical": 4}


class Pair:
    """Two free bodies with axes along the world's, and their relative twist at a common point."""

    def __init__(
        self, masses: tuple[float, float], inertias: tuple[FloatArray, FloatArray], arms: tuple[FloatArray, FloatArray]
    ) -> None:
        self.masses, self.inertias, self.arms = masses, inertias, arms

    def loss_J(self, velocity: FloatArray, free: tuple[int, ...] = ()) -> float:
        """Loss u^T (J M^-1 J^T)^-1 u / 2 over the components of the twist that the latch stops."""
        inverse = np.zeros((12, 12))
        rows = np.zeros((6, 12))
        for i, sign in enumerate((-1.0, 1.0)):
            x, y, z = self.arms[i]
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            at = slice(6 * i, 6 * i + 3), slice(6 * i + 3, 6 * i + 6)
            inverse[at[0], at[0]] = np.eye(3) / self.masses[i]
            inverse[at[1], at[1]] = np.diag(1.0 / self.inertias[i])
            rows[:3, at[0]], rows[:3, at[1]] = sign * np.eye(3), -sign * cross
            rows[3:, at[1]] = sign * np.eye(3)
        rows = np.delete(rows, free, axis=0)
        twist = rows @ velocity
        return float(0.5 * twist @ np.linalg.solve(rows @ inverse @ rows.T, twist))


_SATELLITES = Pair(
    (100.0, 90.0),
    (np.array([18.0, 20.0, 22.0]), np.array([12.0, 15.0, 10.0])),
    (np.array([1.2, 0.1, 0.0]), np.array([-0.6, 0.05, 0.1])),
)
_RATES = (0.05, 0.0, 0.01, 0.0, 0.0, 0.01, -0.02, 0.03, 0.0, 0.06, -0.02, 0.04)
_FREE = {"rigid": (), "ball": (3, 4, 5), "hinge": (3,), "cylindrical": (0, 3)}
"""Components of the relative twist that a latch with its axis along x leaves free."""

_SERVICER = Pair(
    (719.3, 7828.0),
    (np.array([320.0, 350.0, 400.0]), np.array([17023.0, 124826.0, 129112.0])),
    (np.array([2.5, 0.2, 0.1]), np.array([-1.5, 0.4, 0.3])),
)
_TUMBLE = np.radians(3.5)
_APPROACH = (0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, _TUMBLE)


def _grasped(pair: Pair, rates: tuple[float, ...], joint: str, axis: tuple[float, ...] = (1.0, 0.0, 0.0)) -> Run:
    """Run in which a grasp closes at the start; ``axis``: of its latch, if it has one."""

    def body(name: str, i: int, site: str) -> str:
        def text(values: FloatArray) -> str:
            return " ".join(map(repr, values.tolist()))

        place = text(pair.arms[0] - pair.arms[1]) if i else "0 0 0"
        return model(f"""<body name="{name}" pos="{place}"><freejoint name="free"/>
          <inertial pos="0 0 0" mass="{pair.masses[i]}" diaginertia="{text(pair.inertias[i])}"/>
          <geom name="{name}" size="0.01" mass="0"/><site name="{site}" pos="{text(pair.arms[i])}"/></body>""")

    grasp = {
        "robot_site": "grip",
        "object_site": "target/handle",
        "when": {"within": {"position_m": 0.01}},
        "joint": joint,
    } | ({"axis": list(axis)} if joint in ("hinge", "cylindrical") else {})
    off = {"kind": "off"}
    return run_scene(
        body("servicer", 0, "grip"),
        {"target": body("target", 1, "handle")},
        initial={"rates": {"robot/free": list(rates[:6]), "target/free": list(rates[6:])}},
        grasps={"grasp": grasp},
        phases=[
            {"name": "close", "until": "grasp", "arm": ["grasp"], "controller": off},
            {"name": "hold", "until": "end", "controller": off},
        ],
        **times(1e-3, 0.01),
    )


def _latches() -> Values:
    values = {}
    for joint in _LATCHES:
        run = _grasped(_SATELLITES, _RATES, joint)
        (impulse,) = run.records["grasp_impulses"]
        values[joint] = impulse.loss_J
        values[f"energy_{joint}"] = float(run["energy.total_J"][0] - run["energy.total_J"][-1])
    return values


def _mission() -> Values:
    run = _grasped(_SERVICER, _APPROACH, "rigid")
    (impulse,) = run.records["grasp_impulses"]
    return {
        "loss": impulse.loss_J,
        "spin": float(final(run, "v_robot_free")[5]),
        "momentum": float(max(np.ptp(run[f"momentum.total_L_{axis}_N_m_s"]) for axis in "xyz")),
    }


_RODS = Pair(
    (1.0, 1.0), (np.array([0.1, 0.1, 0.1]), np.array([0.1, 0.1, 0.1])), (np.array([0.5, 0, 0]), np.array([-0.5, 0, 0]))
)


def _hinged() -> Values:
    run = _grasped(_RODS, (0.0, 1.0, *[0.0] * 10), "hinge", (0.0, 0.0, 1.0))
    (grasp,) = run.records["grasp_impulses"]
    first, second = (np.array(grasp.qvel_after[f"{name}/free"]) for name in ("robot", "target"))
    return {
        "impulse": float(grasp.impulse_N_s[1]),
        "first": float(first[1]),
        "second": float(second[1]),
        "first_spin": float(first[5]),
        "second_spin": float(second[5]),
        "loss": grasp.loss_J,
        "rank": float(grasp.rank),
    }


def _common_spin() -> float:
    """Rate about z of both bodies after they have become one: angular momentum about the common centre over its inertia."""
    pair, rates = _SERVICER, np.array(_APPROACH)
    masses = np.array(pair.masses)
    places = np.array([np.zeros(3), pair.arms[0] - pair.arms[1]])
    centre = masses @ places / masses.sum()
    drift = (masses[0] * rates[:3] + masses[1] * rates[6:9]) / masses.sum()
    momentum, inertia = np.zeros(3), np.zeros((3, 3))
    for i in range(2):
        off, velocity, spin = places[i] - centre, rates[6 * i : 6 * i + 3] - drift, rates[6 * i + 3 : 6 * i + 6]
        momentum += masses[i] * np.cross(off, velocity) + pair.inertias[i] * spin
        inertia += masses[i] * (off @ off * np.eye(3) - np.outer(off, off)) + np.diag(pair.inertias[i])
    return float(np.linalg.solve(inertia, momentum)[2])


CASES = (
    ValidationCase(
        "latches",
        "Two satellites are latched, with and without freedom",
        Topic.GRASPS,
        Origin.CLOSED_FORM,
        "Loss u^T (J M^-1 J^T)^-1 u / 2 over the stopped components of the relative twist; Brogliato, Nonsmooth"
        " Mechanics, 5",
        "100 and 90 kg, grasps closed at once: rigid, ball, hinge and probe in a cone along x. Evaluated from two 6 x 6"
        " mass matrices, independently of MuJoCo.",
        tuple(
            Number(key, f"{joint}: {what}, J", text_of(_SATELLITES.loss_J(np.array(_RATES), _FREE[joint])), 1e-12, why)
            for joint in _LATCHES
            for key, what, why in (
                (joint, "loss in the record", "rounding of 0.3 J"),
                (f"energy_{joint}", "loss of the kinetic energy", "rounding of 0.3 J, and RK4 over 10 ms"),
            )
        ),
        _latches,
    ),
    ValidationCase(
        "hinge-closes",
        "Two rods are joined end to end by a hinge",
        Topic.GRASPS,
        Origin.CLOSED_FORM,
        "Impulse u / (2 (1/m + b^2 / I)) at the hinge; energy lost u^2 / (4 (1/m + b^2 / I))",
        "Rods of 1 kg and 0.1 kg m^2 along x, ends 0.5 m from their centres; one moves across at 1 m/s, a hinge about z"
        " closes.",
        tuple(
            Number(key, what, text_of(value), 1e-12, "rounding")
            for key, what, value in (
                ("impulse", "impulse, N s", 1 / 7),
                ("first", "speed of the moving rod after, m/s", 6 / 7),
                ("second", "speed of the other rod after, m/s", 1 / 7),
                ("first_spin", "rate of the moving rod after, rad/s", -5 / 7),
                ("second_spin", "rate of the other rod after, rad/s", -5 / 7),
                ("loss", "loss, J", 1 / 14),
                ("rank", "stopped relative motions", 5.0),
            )
        ),
        _hinged,
    ),
    ValidationCase(
        "mission-capture",
        "A servicer of DEOS's size captures a body of Envisat's",
        Topic.GRASPS,
        Origin.CLOSED_FORM,
        "Plastic impulse as above; masses: DEOS base 696.2 kg and arm 7 x 3.3 kg (SpaceDyn v2r1), Envisat 7828 kg,"
        " diag(17023, 124826, 129112) kg m^2, 3.5 deg/s; inertia of the servicer and places of the grasp are assumed",
        "The arm is rigid in the capture: servicer of 719.3 kg. Approach at 2 cm/s.",
        (
            Number("loss", "loss, J", text_of(_SERVICER.loss_J(np.array(_APPROACH))), 1e-10, "rounding of 240 J"),
            Number("spin", "rate of the servicer about z after, rad/s", text_of(_common_spin()), 1e-6, "turning over 10 ms"),
            Number("momentum", "change of the angular momentum, N m s", "0", 1e-9, "rounding of 8000 N m s over ten steps"),
        ),
        _mission,
    ),
)
