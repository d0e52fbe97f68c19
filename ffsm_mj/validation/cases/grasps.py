"""Grasps: plastic impulses of free bodies, of a mission-sized servicer, of two arms that close a loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.free_bodies import FreeBodies
from ffsm_mj.validation.scene import body, final, model, run_scene, text_of, times, vector

_OFF = {"kind": "off"}


def _site(name: str, at: Sequence[float] | FloatArray) -> str:
    return f'<site name="{name}" pos="{vector(at)}"/>'


def _grasp(robot_site: str, object_site: str, near_m: float, **latch: Any) -> dict[str, Any]:
    """A grasp that closes at once where its sites are."""
    return {"robot_site": robot_site, "object_site": object_site, "when": {"within": {"position_m": near_m}}} | latch


def _axis(name: str) -> FloatArray:
    return np.asarray(np.eye(3)["xyz".index(name)])


@dataclass(frozen=True)
class _Pair:
    """Two free bodies with axes along the world's: masses, moments of inertia, and places of a common point in them."""

    masses: tuple[float, float]
    inertias: tuple[Sequence[float], Sequence[float]]
    arms: tuple[Sequence[float], Sequence[float]]

    def text(self, name: str, i: int, sites: str) -> str:
        """MJCF of a body."""
        place = np.subtract(self.arms[0], self.arms[1]) if i else np.zeros(3)
        return model(body(name, self.masses[i], self.inertias[i], sites, at=place))

    def joined(self, rates: Sequence[float], free: Sequence[int] = ()) -> FreeBodies:
        """Both, joined at the point but for components of the relative twist that a latch leaves free."""
        bodies = FreeBodies()
        for i, arm in enumerate(self.arms):
            origin = np.subtract(self.arms[0], arm)
            bodies.add(self.masses[i], np.array(self.inertias[i]), origin, np.zeros(3), np.array(rates[6 * i : 6 * i + 6]))
        bodies.weld(0, 1, np.array(self.arms[0]), free)
        return bodies


_SATELLITES = _Pair((100.0, 90.0), ((18.0, 20.0, 22.0), (12.0, 15.0, 10.0)), ((1.2, 0.1, 0.0), (-0.6, 0.05, 0.1)))
_RATES = (0.05, 0.0, 0.01, 0.0, 0.0, 0.01, -0.02, 0.03, 0.0, 0.06, -0.02, 0.04)
_FREE = {"rigid": (), "ball": (3, 4, 5), "hinge": (3,), "cylindrical": (0, 3)}
"""Components of the relative twist that a latch with its axis along x leaves free."""
_TARGET_KG, _TARGET_KG_M2 = 7828.0, (17023.0, 124826.0, 129112.0)
_BASE_KG_M2 = (320.0, 350.0, 400.0)
_HANDLE_M = (-1.5, 0.4, 0.3)
_TUMBLE = float(np.radians(3.5))
_SERVICER = _Pair((719.3, _TARGET_KG), (_BASE_KG_M2, _TARGET_KG_M2), ((2.5, 0.2, 0.1), _HANDLE_M))
_APPROACH = (0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, _TUMBLE)
_RODS = _Pair((1.0, 1.0), ([0.1] * 3, [0.1] * 3), ((0.5, 0.0, 0.0), (-0.5, 0.0, 0.0)))


def _closing(robot: str, target: str, initial: dict[str, Any], **latch: Any) -> Run:
    """Run of 10 ms in which a grasp closes at the start."""
    return run_scene(
        robot,
        {"target": target},
        initial=initial,
        grasps={"grasp": _grasp("grip", "target/handle", 0.01, **latch)},
        phases=[
            {"name": "close", "until": "grasp", "arm": ["grasp"], "controller": _OFF},
            {"name": "hold", "until": "end", "controller": _OFF},
        ],
        **times(1e-3, 0.01),
    )


def _grasped(pair: _Pair, rates: Sequence[float], joint: str, axis: tuple[float, ...] = (1.0, 0.0, 0.0)) -> Run:
    """Run in which a grasp closes at the start; ``axis``: of its latch, if it has one."""
    return _closing(
        pair.text("servicer", 0, _site("grip", pair.arms[0])),
        pair.text("target", 1, _site("handle", pair.arms[1])),
        {"rates": {"robot/free": list(rates[:6]), "target/free": list(rates[6:])}},
        joint=joint,
        **({"axis": list(axis)} if joint in ("hinge", "cylindrical") else {}),
    )


def _latches() -> Values:
    values = {}
    for joint in _FREE:
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


_BASE_KG, _LINK_KG, _LINK_KG_M2, _LINK_M = 696.2, 3.3, (0.01, 0.08, 0.08), 0.45
_MOUNT_M, _NEXT_M, _MIDDLE_M = (0.9, 0.2, 0.1), (_LINK_M, 0.0, 0.0), (0.5 * _LINK_M, 0.0, 0.0)
_AXES = ("z", "y", "x", "y", "x", "y", "x")
_ANGLES = (0.3, -0.7, 0.2, 1.1, -0.4, -0.6, 0.5)
_TARGET_RATES = (-0.02, 0.01, 0.0, 0.0, 0.01, _TUMBLE)


def _bodies() -> FreeBodies:
    """Base, seven links and the target, welded to the last link."""
    bodies = FreeBodies()
    last, at = bodies.add(_BASE_KG, np.array(_BASE_KG_M2), np.zeros(3), np.zeros(3)), np.array(_MOUNT_M)
    link = _LINK_KG, np.array(_LINK_KG_M2), np.array(_MIDDLE_M)
    for name, angle in zip(_AXES, _ANGLES, strict=True):
        last, at = bodies.hinge(last, at, _axis(name), angle, 0.0, *link), np.array(_NEXT_M)
    grip = bodies.bodies[last].origin + bodies.bodies[last].R @ _NEXT_M
    target = bodies.add(_TARGET_KG, np.array(_TARGET_KG_M2), grip - _HANDLE_M, np.zeros(3), np.array(_TARGET_RATES))
    bodies.weld(last, target, grip)
    return bodies


def _free_arm() -> Values:
    arm = _site("grip", _NEXT_M)
    for i in reversed(range(7)):
        joint = f'<joint name="joint{i + 1}" axis="{vector(_axis(_AXES[i]))}"/>'
        place = _NEXT_M if i else _MOUNT_M
        arm = body(f"link{i + 1}", _LINK_KG, _LINK_KG_M2, arm, joint=joint, at=place, centre=_MIDDLE_M)
    handle, centre = _site("handle", _HANDLE_M), _bodies().bodies[8].centre
    joints = {f"robot/joint{i + 1}": angle for i, angle in enumerate(_ANGLES)}
    run = _closing(
        model(body("base", _BASE_KG, _BASE_KG_M2, arm)),
        model(body("target", _TARGET_KG, _TARGET_KG_M2, handle, at=centre)),
        {"joints": joints, "rates": {"target/free": list(_TARGET_RATES)}},
    )
    (grasp,) = run.records["grasp_impulses"]
    jump = np.array(grasp.qvel_after["robot/free"])
    energy_J = float(0.5 * _BASE_KG * jump[:3] @ jump[:3] + 0.5 * jump[3:] @ (_BASE_KG_M2 * jump[3:]))
    values = {f"jump{i}": float(value) for i, value in enumerate(jump)}
    values |= {f"impulse{i}": float(value) for i, value in enumerate(grasp.impulse_N_s)}
    return values | {
        "loss": -grasp.energy_change_J,
        "base": energy_J,
        "arm": float(np.ravel(grasp.energy_after_J["robot"])[0]) - energy_J,
        "target": float(np.ravel(grasp.energy_after_J["objects"])[0]),
        "momentum": grasp.angular_momentum_change_N_m_s,
    }


def _free_arm_numbers() -> tuple[Number, ...]:
    bodies = _bodies()
    after = bodies.plastic()
    impulse = _TARGET_KG * (after[8, :3] - _TARGET_RATES[:3])
    energies = bodies.energies(after)
    why = "rounding of 249 J and 0.06 rad/s, rows of constraints conditioned by 112"
    units = ["m/s"] * 3 + ["rad/s"] * 3
    shares = {"base": energies[0], "arm": energies[1:8].sum(), "target": energies[8]}
    return (
        *(
            Number(f"jump{i}", f"base after, {'xyz'[i % 3]}, {unit}", text_of(after[0][i]), 1e-11, why)
            for i, unit in enumerate(units)
        ),
        *(
            Number(f"impulse{i}", f"impulse on the target, {'xyz'[i]}, N s", text_of(impulse[i]), 1e-9, why)
            for i in range(3)
        ),
        Number("loss", "loss, J", text_of(bodies.loss_J()), 1e-9, why),
        *(Number(name, f"energy of the {name} after, J", text_of(share), 1e-9, why) for name, share in shares.items()),
        Number("momentum", "change of the angular momentum, N m s", "0", 1e-9, "rounding of 8000 N m s"),
    )


_AXES_OF_HANDS = {"planar": ("z", "z", "z"), "spatial": ("z", "x", "z")}
_LINKS = ((1.2, 0.25, (0.03, 0.01, 0.03)), (0.9, 0.2, (0.02, 0.008, 0.02)), (0.5, 0.1, (0.005, 0.003, 0.005)))
"""Mass, place of the mass centre along the link, moments of inertia."""
_ALONG_M = (0.0, 0.5, 0.4)
_ARM_ANGLES = (0.3, -0.7, 0.2, -0.25, 0.6, -0.3)
_TORSO_KG, _TORSO_KG_M2 = 10.0, (0.8, 0.7, 0.9)
_OBJECT_KG, _OBJECT_KG_M2, _OBJECT_CENTRE = 3.0, (0.05, 0.08, 0.06), (0.03, 0.02, 0.0)
_ARMS = {"l": -1.0, "r": 1.0}


def _place(arm: str, k: int) -> FloatArray:
    """Place of a link in the one before, (3,), m."""
    return np.array([0.0, _ALONG_M[k], 0.0] if k else [_ARMS[arm] * 0.3, 0.0, 0.0])


def _rates() -> FloatArray:
    """Velocities of base, joints and object, 18 numbers."""
    return np.asarray(0.3 * np.random.default_rng(3).normal(size=18))


def _system(axes: tuple[str, ...]) -> tuple[FreeBodies, FloatArray, dict[str, FloatArray]]:
    """Bodies with both hands welded to the object; its origin, and the places of the hands."""
    v, bodies, ends = _rates(), FreeBodies(), list[int]()
    base = bodies.add(_TORSO_KG, np.array(_TORSO_KG_M2), np.zeros(3), np.zeros(3), v[:6])
    for i, arm in enumerate(_ARMS):
        last = base
        for k, (mass, centre, inertia) in enumerate(_LINKS):
            link = mass, np.array(inertia), np.array([0.0, centre, 0.0])
            last = bodies.hinge(last, _place(arm, k), _axis(axes[k]), _ARM_ANGLES[3 * i + k], v[6 + 3 * i + k], *link)
        ends.append(last)
    hands = [bodies.bodies[end].origin for end in ends]
    origin = np.mean(hands, axis=0) + np.array([0.0, 0.15, 0.0])
    target = bodies.add(_OBJECT_KG, np.array(_OBJECT_KG_M2), origin, np.array(_OBJECT_CENTRE), v[12:])
    for end, hand in zip(ends, hands, strict=True):
        bodies.weld(end, target, hand)
    return bodies, origin, dict(zip(_ARMS, hands, strict=True))


def _arm(name: str, axes: tuple[str, ...]) -> str:
    text = f'<site name="hand_{name}"/>'
    for k in reversed(range(3)):
        mass, centre, inertia = _LINKS[k]
        joint = f'<joint name="{name}{k}" axis="{vector(_axis(axes[k]))}"/>'
        text = body(f"{name}{k}", mass, inertia, text, joint=joint, at=_place(name, k), centre=(0.0, centre, 0.0))
    return text


def _closed(axes: tuple[str, ...]) -> Run:
    """Run in which both hands close at the start, then 0.1 s of coasting."""
    _, origin, hands = _system(axes)
    v = _rates()
    sites = "".join(_site(f"at_{name}", hand - origin) for name, hand in hands.items())
    target = body("target", _OBJECT_KG, _OBJECT_KG_M2, sites, at=origin, centre=_OBJECT_CENTRE)
    joints = [f"robot/{name}{k}" for name in _ARMS for k in range(3)]
    rates = {"robot/free": v[:6].tolist(), "target/free": v[12:].tolist()}
    return run_scene(
        model(body("base", _TORSO_KG, _TORSO_KG_M2, _arm("l", axes) + _arm("r", axes))),
        {"target": model(target)},
        initial={
            "joints": dict(zip(joints, _ARM_ANGLES, strict=True)),
            "rates": rates | dict(zip(joints, v[6:12].tolist(), strict=True)),
        },
        grasps={name: _grasp(f"hand_{name}", f"target/at_{name}", 1e-3) for name in _ARMS},
        phases=[{"name": "hold", "until": "end", "arm": list(_ARMS), "controller": _OFF}],
        **times(1e-3, 0.1),
    )


def _hands() -> Values:
    values: dict[str, float] = {}
    for name, axes in _AXES_OF_HANDS.items():
        run = _closed(axes)
        closings = run.records["grasp_impulses"]
        last = max(closings, key=lambda closing: closing.place)
        base = np.array(last.qvel_after["robot/free"])
        values |= {
            f"{name}_loss": sum(closing.loss_J for closing in closings),
            f"{name}_rank": float(sum(closing.rank for closing in closings)),
            f"{name}_mobility": float(last.mobility),
            f"{name}_x": float(base[0]),
            f"{name}_turn": float(base[5]),
            f"{name}_drift": float(np.ptp(run["energy.total_J"][1:])),
        }
    return values


def _hands_numbers() -> tuple[Number, ...]:
    numbers = []
    for name, rank, conditioned in (("planar", 9, "52"), ("spatial", 12, "1e4")):
        bodies, _, _ = _system(_AXES_OF_HANDS[name])
        after = bodies.plastic()
        why = f"rounding, rows of constraints conditioned by {conditioned}"
        numbers += [
            Number(f"{name}_rank", f"{name}: stopped relative motions", str(rank), 0.0, "a count"),
            Number(f"{name}_mobility", f"{name}: degrees of freedom left", str(18 - rank), 0.0, "18 less those stopped"),
            Number(f"{name}_loss", f"{name}: loss of both closings, J", text_of(bodies.loss_J()), 1e-11, why),
            Number(f"{name}_x", f"{name}: base after, x, m/s", text_of(after[0][0]), 1e-11, why),
            Number(f"{name}_turn", f"{name}: base after, rate about z, rad/s", text_of(after[0][5]), 1e-11, why),
            Number(f"{name}_drift", f"{name}: change of the energy in 0.1 s of coasting, J", "0", 1e-10, "RK4 at 1 ms"),
        ]
    return tuple(numbers)


_BALL_RODS = _Pair((1.0, 2.0), ((0.1, 0.2, 0.15), (0.3, 0.1, 0.2)), ((0.5, 0.0, 0.0), (-0.5, 0.0, 0.0)))
_ROD_RATES = (0.2, 1.0, -0.1, 0.3, -0.4, 0.5, -0.1, 0.2, 0.3, -0.2, 0.1, 0.6)
_BETWEEN_M = 0.2


def _balls() -> Values:
    """Two ball latches at places above each other."""
    rods = []
    for i, name in enumerate(("rod", "other")):
        x, y, z = _BALL_RODS.arms[i]
        rods.append(_BALL_RODS.text(name, i, _site("p", (x, y, z)) + _site("q", (x, y, z + _BETWEEN_M))))
    run = run_scene(
        rods[0],
        {"other": rods[1]},
        initial={"rates": {"robot/free": list(_ROD_RATES[:6]), "other/free": list(_ROD_RATES[6:])}},
        grasps={site: _grasp(f"robot/{site}", f"other/{site}", 1e-3, joint="ball") for site in "pq"},
        phases=[{"name": "hold", "until": "end", "arm": ["p", "q"], "controller": _OFF}],
        **times(1e-3, 0.01),
    )
    closings = run.records["grasp_impulses"]
    return {
        "loss": sum(closing.loss_J for closing in closings),
        "energy": float(run["energy.total_J"][0] - run["energy.total_J"][-1]),
        "rank": float(sum(closing.rank for closing in closings)),
    }


_HINGE_LOSS = text_of(_BALL_RODS.joined(_ROD_RATES, (5,)).loss_J())

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
            Number(key, f"{joint}: {what}, J", text_of(_SATELLITES.joined(_RATES, _FREE[joint]).loss_J()), 1e-12, why)
            for joint in _FREE
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
            Number("loss", "loss, J", text_of(_SERVICER.joined(_APPROACH).loss_J()), 1e-10, "rounding of 240 J"),
            Number(
                "spin",
                "rate of the servicer about z after, rad/s",
                text_of(_SERVICER.joined(_APPROACH).plastic()[0][5]),
                1e-6,
                "turning over 10 ms",
            ),
            Number("momentum", "change of the angular momentum, N m s", "0", 1e-9, "rounding of 8000 N m s over ten steps"),
        ),
        _mission,
    ),
    ValidationCase(
        "mission-arm",
        "A servicer of DEOS's size with a free arm captures a body of Envisat's: jump of the base, shares of the bodies",
        Topic.GRASPS,
        Origin.CLOSED_FORM,
        "Plastic impulse in maximal coordinates: nine free bodies with 35 constraints of hinges and 6 of the grasp,"
        " v+ = v - M^-1 J^T (J M^-1 J^T)^-1 J v, evaluated apart from MuJoCo; masses: DEOS base 696.2 kg and arm 7 x 3.3 kg"
        " (SpaceDyn v2r1), Envisat 7828 kg, diag(17023, 124826, 129112) kg m^2, 3.5 deg/s",
        "Servicer at rest, arm bent, joints free in the capture. Inertias of base and links, dimensions and posture are"
        " assumed.",
        _free_arm_numbers(),
        _free_arm,
        "Free joints make the capture soft for the base; with a locked arm, as in `mission-capture`, the base takes"
        " part as one body with it.",
    ),
    ValidationCase(
        "two-balls-a-hinge",
        "Two ball latches make a hinge",
        Topic.GRASPS,
        Origin.CLOSED_FORM,
        "Loss u^T (J M^-1 J^T)^-1 u / 2 over the five components of the relative twist that a hinge through both balls"
        " stops",
        f"Bodies of 1 and 2 kg in general motion; ball latches {_BETWEEN_M} m apart close at the start, the second as a"
        " closed loop.",
        (
            Number("loss", "loss of both closings, J", _HINGE_LOSS, 1e-12, "rounding"),
            Number("energy", "loss of the kinetic energy, J", _HINGE_LOSS, 1e-11, "rounding, and RK4 over 10 ms"),
            Number("rank", "stopped relative motions: 3 and 2", "5", 0.0, "a count"),
        ),
        _balls,
    ),
    ValidationCase(
        "two-hands",
        "Two arms close on one object",
        Topic.GRASPS,
        Origin.CLOSED_FORM,
        "Plastic impulse in maximal coordinates: eight free bodies with 30 constraints of hinges and 12 of the grasps,"
        " by the pseudo-inverse, evaluated apart from MuJoCo; in the plane three of the twelve depend on the others",
        "Base of 10 kg with two arms of three hinges each (all about z, or z, x, z), object of 3 kg, velocities of 0.3"
        " times `default_rng(3).normal`; two rigid grasps close at the start. Then 0.1 s of coasting; RK4 at 1 ms.",
        _hands_numbers(),
        _hands,
    ),
)
