"""A mission-sized capture with a free arm: jump of the base and the share of each body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.free_bodies import FreeBodies
from ffsm_mj.validation.scene import model, run_scene, text_of, times

_BASE_KG, _BASE_KG_M2 = 696.2, np.array([320.0, 350.0, 400.0])
_LINK_KG, _LINK_KG_M2, _LINK_M = 3.3, np.array([0.01, 0.08, 0.08]), 0.45
_MOUNT_M = np.array([0.9, 0.2, 0.1])
_AXES = ("z", "y", "x", "y", "x", "y", "x")
_ANGLES = (0.3, -0.7, 0.2, 1.1, -0.4, -0.6, 0.5)
_TARGET_KG, _TARGET_KG_M2 = 7828.0, np.array([17023.0, 124826.0, 129112.0])
_HANDLE_M = np.array([-1.5, 0.4, 0.3])
_TARGET_M_S, _TARGET_RAD_S = np.array([-0.02, 0.01, 0.0]), np.array([0.0, 0.01, np.radians(3.5)])


def _axis(name: str) -> FloatArray:
    return np.asarray(np.eye(3)["xyz".index(name)])


def _bodies() -> FreeBodies:
    """Base, seven links and the target, welded to the last link."""
    found = FreeBodies()
    body, at = found.add(_BASE_KG, _BASE_KG_M2, np.zeros(3), np.zeros(3)), _MOUNT_M
    along = np.array([_LINK_M, 0.0, 0.0])
    for name, angle in zip(_AXES, _ANGLES, strict=True):
        body, at = found.hinge(body, at, _axis(name), angle, 0.0, _LINK_KG, _LINK_KG_M2, 0.5 * along), along
    grip = found.bodies[body].origin + found.bodies[body].R @ along
    velocity = np.concatenate([_TARGET_M_S, _TARGET_RAD_S])
    found.weld(body, found.add(_TARGET_KG, _TARGET_KG_M2, grip - _HANDLE_M, np.zeros(3), velocity), grip)
    return found


def _text(values: Sequence[float] | FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)


def _inertial(mass: float, inertia: FloatArray, x: float = 0.0) -> str:
    return f'<inertial pos="{x!r} 0 0" mass="{mass}" diaginertia="{_text(inertia)}"/>'


def _arm() -> str:
    """MJCF of the links, each in the one before."""
    end = f'<site name="grip" pos="{_LINK_M} 0 0"/>'
    for i in reversed(range(7)):
        place = _MOUNT_M if i == 0 else np.array([_LINK_M, 0.0, 0.0])
        axis = _axis(_AXES[i])
        end = f"""<body name="link{i + 1}" pos="{_text(place)}"><joint name="joint{i + 1}" axis="{_text(axis)}"/>
          {_inertial(_LINK_KG, _LINK_KG_M2, 0.5 * _LINK_M)}<geom name="link{i + 1}" size="0.01" mass="0"/>{end}</body>"""
    return end


def _values() -> Values:
    base = f"""<body name="base"><freejoint name="free"/>{_inertial(_BASE_KG, _BASE_KG_M2)}
      <geom name="base" size="0.01" mass="0"/>{_arm()}</body>"""
    target = f"""<body name="target" pos="{_text(_bodies().bodies[8].centre)}"><freejoint name="free"/>
      {_inertial(_TARGET_KG, _TARGET_KG_M2)}<geom name="target" size="0.01" mass="0"/>
      <site name="handle" pos="{_text(_HANDLE_M)}"/></body>"""
    off = {"kind": "off"}
    run = run_scene(
        model(base),
        {"target": model(target)},
        initial={
            "joints": {f"robot/joint{i + 1}": angle for i, angle in enumerate(_ANGLES)},
            "rates": {"target/free": [*_TARGET_M_S.tolist(), *_TARGET_RAD_S.tolist()]},
        },
        grasps={"grasp": {"robot_site": "grip", "object_site": "target/handle", "when": {"within": {"position_m": 0.01}}}},
        phases=[
            {"name": "close", "until": "grasp", "arm": ["grasp"], "controller": off},
            {"name": "hold", "until": "end", "controller": off},
        ],
        **times(1e-3, 0.01),
    )
    (grasp,) = run.records["grasp_impulses"]
    jump = np.array(grasp.qvel_after["robot/free"])
    own = 0.5 * _BASE_KG * jump[:3] @ jump[:3] + 0.5 * jump[3:] @ (_BASE_KG_M2 * jump[3:])
    robot = float(np.ravel(grasp.energy_after_J["robot"])[0])
    values = {f"jump{i}": float(each) for i, each in enumerate(jump)} | {
        f"impulse{i}": float(each) for i, each in enumerate(grasp.impulse_N_s)
    }
    return values | {
        "loss": -grasp.energy_change_J,
        "base": float(own),
        "arm": robot - float(own),
        "target": float(np.ravel(grasp.energy_after_J["objects"])[0]),
        "momentum": grasp.angular_momentum_change_N_m_s,
    }


def _numbers() -> tuple[Number, ...]:
    bodies = _bodies()
    velocities = bodies.plastic()
    impulse = _TARGET_KG * (velocities[8, :3] - _TARGET_M_S)
    energies, first = bodies.energies(velocities), bodies.energies(bodies.velocities)
    why = "rounding of 249 J and 0.06 rad/s, rows of constraints conditioned by 112"
    jumps = [
        Number(
            f"jump{i}", f"base after, {'xyz'[i % 3]}, {'m/s' if i < 3 else 'rad/s'}", text_of(velocities[0][i]), 1e-11, why
        )
        for i in range(6)
    ]
    pulls = [
        Number(f"impulse{i}", f"impulse on the target, {'xyz'[i]}, N s", text_of(impulse[i]), 1e-9, why) for i in range(3)
    ]
    shares = {"base": energies[0], "arm": energies[1:8].sum(), "target": energies[8]}
    return (
        *jumps,
        *pulls,
        Number("loss", "loss, J", text_of(float(first.sum() - energies.sum())), 1e-9, why),
        *(
            Number(name, f"energy of the {name} after, J", text_of(float(share)), 1e-9, why)
            for name, share in shares.items()
        ),
        Number("momentum", "change of the angular momentum, N m s", "0", 1e-9, "rounding of 8000 N m s"),
    )


CASES = (
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
        _numbers(),
        _values,
        "Free joints make the capture soft for the base; with a locked arm, as in `mission-capture`, the base takes"
        " part as one body with it.",
    ),
)
