"""Two grasps at once: closed loops, with the relative motions that are left."""

from __future__ import annotations

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.cases.grasps import Pair
from ffsm_mj.validation.free_bodies import FreeBodies
from ffsm_mj.validation.scene import model, run_scene, text_of, times

_PLANAR, _SPATIAL = ("z", "z", "z"), ("z", "x", "z")
_LINKS = ((1.2, 0.25, (0.03, 0.01, 0.03)), (0.9, 0.2, (0.02, 0.008, 0.02)), (0.5, 0.1, (0.005, 0.003, 0.005)))
"""Mass, place of the mass centre along the link, moments of inertia."""
_ALONG_M = (0.0, 0.5, 0.4)
_ANGLES = (0.3, -0.7, 0.2, -0.25, 0.6, -0.3)
_BASE_KG, _BASE_KG_M2 = 10.0, np.array([0.8, 0.7, 0.9])
_OBJECT_KG, _OBJECT_KG_M2, _OBJECT_CENTRE = 3.0, np.array([0.05, 0.08, 0.06]), np.array([0.03, 0.02, 0.0])
_ARMS = {"l": -1.0, "r": 1.0}


def _axis(name: str) -> FloatArray:
    return np.asarray(np.eye(3)["xyz".index(name)])


def _rates() -> FloatArray:
    """Velocities of base, joints and object, 18 numbers."""
    return np.asarray(0.3 * np.random.default_rng(3).normal(size=18))


def _system(axes: tuple[str, ...]) -> tuple[FreeBodies, FloatArray, list[FloatArray]]:
    """Bodies with both hands welded to the object; its origin, and the places of the hands."""
    v, bodies, hands = _rates(), FreeBodies(), []
    base = bodies.add(_BASE_KG, _BASE_KG_M2, np.zeros(3), np.zeros(3), v[:6])
    ends = []
    for arm, side in enumerate(_ARMS.values()):
        body = base
        for k, (mass, centre, inertia) in enumerate(_LINKS):
            at = np.array([side * 0.3, 0.0, 0.0]) if k == 0 else np.array([0.0, _ALONG_M[k], 0.0])
            j = 3 * arm + k
            link = mass, np.array(inertia), np.array([0.0, centre, 0.0])
            body = bodies.hinge(body, at, _axis(axes[k]), _ANGLES[j], v[6 + j], *link)
        ends.append(body)
        hands.append(bodies.bodies[body].origin)
    origin = np.mean(hands, axis=0) + np.array([0.0, 0.15, 0.0])
    target = bodies.add(_OBJECT_KG, _OBJECT_KG_M2, origin, _OBJECT_CENTRE, v[12:])
    for body, hand in zip(ends, hands, strict=True):
        bodies.weld(body, target, hand)
    return bodies, origin, hands


def _text(values: FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)


def _arm(name: str, axes: tuple[str, ...]) -> str:
    text = f'<site name="hand_{name}"/>'
    for k in reversed(range(3)):
        mass, centre, inertia = _LINKS[k]
        place = f"{_ARMS[name] * 0.3} 0 0" if k == 0 else f"0 {_ALONG_M[k]} 0"
        text = f"""<body name="{name}{k}" pos="{place}"><joint name="{name}{k}" axis="{_text(_axis(axes[k]))}"/>
          <inertial pos="0 {centre} 0" mass="{mass}" diaginertia="{_text(np.array(inertia))}"/>
          <geom name="{name}{k}" size="0.001" mass="0"/>{text}</body>"""
    return text


def _closed(axes: tuple[str, ...]) -> Run:
    """Run in which both hands close at the start, then 0.1 s of coasting."""
    _, origin, hands = _system(axes)
    v = _rates()
    base = f"""<body name="base"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="{_BASE_KG}" diaginertia="{_text(_BASE_KG_M2)}"/><geom name="base" size="0.01" mass="0"/>
      {_arm("l", axes)}{_arm("r", axes)}</body>"""
    places = dict(zip(_ARMS, hands, strict=True))
    sites = "".join(f'<site name="at_{name}" pos="{_text(hand - origin)}"/>' for name, hand in places.items())
    target = f"""<body name="target" pos="{_text(origin)}"><freejoint name="free"/>
      <inertial pos="{_text(_OBJECT_CENTRE)}" mass="{_OBJECT_KG}" diaginertia="{_text(_OBJECT_KG_M2)}"/>
      <geom name="target" size="0.01" mass="0"/>{sites}</body>"""
    joints = [f"{name}{k}" for name in _ARMS for k in range(3)]
    grasps = {
        name: {"robot_site": f"hand_{name}", "object_site": f"target/at_{name}", "when": {"within": {"position_m": 1e-3}}}
        for name in _ARMS
    }
    return run_scene(
        model(base),
        {"target": model(target)},
        initial={
            "joints": {f"robot/{joint}": angle for joint, angle in zip(joints, _ANGLES, strict=True)},
            "rates": {"robot/free": v[:6].tolist(), "target/free": v[12:].tolist()}
            | {f"robot/{joint}": float(rate) for joint, rate in zip(joints, v[6:12], strict=True)},
        },
        grasps=grasps,
        phases=[{"name": "hold", "until": "end", "arm": list(_ARMS), "controller": {"kind": "off"}}],
        **times(1e-3, 0.1),
    )


def _hands() -> Values:
    values: dict[str, float] = {}
    for name, axes in (("planar", _PLANAR), ("spatial", _SPATIAL)):
        run = _closed(axes)
        closings = run.records["grasp_impulses"]
        last = max(closings, key=lambda each: each.place)
        base = np.array(last.qvel_after["robot/free"])
        energy = run["energy.total_J"]
        values |= {
            f"{name}_loss": sum(each.loss_J for each in closings),
            f"{name}_rank": float(sum(each.rank for each in closings)),
            f"{name}_mobility": float(last.mobility),
            f"{name}_x": float(base[0]),
            f"{name}_turn": float(base[5]),
            f"{name}_drift": float(np.ptp(energy[1:])),
        }
    return values


_CONDITIONED = {"planar": "52", "spatial": "1e4"}


def _hands_numbers() -> tuple[Number, ...]:
    numbers = []
    for name, axes, rank in (("planar", _PLANAR, 9), ("spatial", _SPATIAL, 12)):
        bodies, _, _ = _system(axes)
        after = bodies.plastic()
        loss = float((bodies.energies(bodies.velocities) - bodies.energies(after)).sum())
        why = f"rounding, rows of constraints conditioned by {_CONDITIONED[name]}"
        numbers += [
            Number(f"{name}_rank", f"{name}: stopped relative motions", str(rank), 0.0, "a count"),
            Number(f"{name}_mobility", f"{name}: degrees of freedom left", str(18 - rank), 0.0, "18 less those stopped"),
            Number(f"{name}_loss", f"{name}: loss of both closings, J", text_of(loss), 1e-11, why),
            Number(f"{name}_x", f"{name}: base after, x, m/s", text_of(after[0][0]), 1e-11, why),
            Number(f"{name}_turn", f"{name}: base after, rate about z, rad/s", text_of(after[0][5]), 1e-11, why),
            Number(f"{name}_drift", f"{name}: change of the energy in 0.1 s of coasting, J", "0", 1e-10, "RK4 at 1 ms"),
        ]
    return tuple(numbers)


_RODS = Pair(
    (1.0, 2.0), (np.array([0.1, 0.2, 0.15]), np.array([0.3, 0.1, 0.2])), (np.array([0.5, 0, 0]), np.array([-0.5, 0, 0]))
)
_ROD_RATES = np.array([0.2, 1.0, -0.1, 0.3, -0.4, 0.5, -0.1, 0.2, 0.3, -0.2, 0.1, 0.6])
_BETWEEN_M = 0.2


def _balls() -> Values:
    """Two ball latches at places above each other."""

    def rod(name: str, i: int) -> str:
        place = _RODS.arms[0] - _RODS.arms[1] if i else np.zeros(3)
        sites = "".join(
            f'<site name="{site}" pos="{_text(_RODS.arms[i] + np.array([0.0, 0.0, up]))}"/>'
            for site, up in (("p", 0.0), ("q", _BETWEEN_M))
        )
        return model(f"""<body name="{name}" pos="{_text(place)}"><freejoint name="free"/>
          <inertial pos="0 0 0" mass="{_RODS.masses[i]}" diaginertia="{_text(_RODS.inertias[i])}"/>
          <geom name="{name}" size="0.01" mass="0"/>{sites}</body>""")

    run = run_scene(
        rod("rod", 0),
        {"other": rod("other", 1)},
        initial={"rates": {"robot/free": _ROD_RATES[:6].tolist(), "other/free": _ROD_RATES[6:].tolist()}},
        grasps={
            site: {
                "robot_site": f"robot/{site}",
                "object_site": f"other/{site}",
                "when": {"within": {"position_m": 1e-3}},
                "joint": "ball",
            }
            for site in "pq"
        },
        phases=[{"name": "hold", "until": "end", "arm": ["p", "q"], "controller": {"kind": "off"}}],
        **times(1e-3, 0.01),
    )
    closings = run.records["grasp_impulses"]
    return {
        "loss": sum(each.loss_J for each in closings),
        "energy": float(run["energy.total_J"][0] - run["energy.total_J"][-1]),
        "rank": float(sum(each.rank for each in closings)),
    }


_HINGE_LOSS = text_of(_RODS.loss_J(_ROD_RATES, (5,)))

CASES = (
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
