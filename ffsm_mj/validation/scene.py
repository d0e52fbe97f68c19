"""Scenes of validation cases: MJCF and scenarios stated in Python, run as if they were files."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.prepare import prepare, uninterrupted

FAR = 1e12
"""A spring towards a target so far away is a constant force."""
FREE = '<freejoint name="free"/>'


def constant(joint: str, effort: float) -> dict[str, Any]:
    """Control law of a constant effort at a joint, N or N m."""
    return {"kind": "pd", "joints": [joint], "kp": abs(effort) / FAR, "kd": 0.0, "target": [math.copysign(FAR, effort)]}


def growing(actuator: str, rate: float, step_s: float, duration_s: float) -> tuple[dict[str, Any], dict[str, str]]:
    """Control law of an effort that grows evenly from zero, in N/s or N m/s, and the file that it plays.

    Efforts are held from tick to tick, each at its mean over the tick: velocities at ticks are those of the ramp.
    """
    rows = "\n".join(f"{k * step_s!r},{rate * (k + 0.5) * step_s!r}" for k in range(round(duration_s / step_s) + 1))
    law = {"kind": "playback", "file": "ramp.csv", "columns": {actuator: 2}, "time": {"column": 1, "unit": "s"}, "unit": "N"}
    return law, {"ramp.csv": rows + "\n"}


def run_scene(
    robot: str, objects: Mapping[str, str] | None = None, files: Mapping[str, str] | None = None, **scenario: Any
) -> Run:
    """Run a scene and keep its log in memory.

    Args:
        robot: MJCF of the robot.
        objects: MJCF by name; an object without a joint does not move.
        files: Text of other files that the scenario names.
        scenario: Keys of the scenario beside its models. Default: no contacts, actuators off.
    """
    models = {"robot": robot, **(objects or {})}
    data: dict[str, Any] = {
        "name": "validation",
        "robot": {"mjcf": "robot.xml"},
        "objects": {
            name: {"mjcf": f"{name}.xml"} | ({} if "joint" in mjcf else {"fixed": True})
            for name, mjcf in (objects or {}).items()
        },
        "contacts": {"rules": []},
        "phases": [{"name": "coast", "until": "end", "controller": {"kind": "off"}}],
    }
    with TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in {f"{name}.xml": mjcf for name, mjcf in models.items()}.items() | (files or {}).items():
            (folder / file).write_text(text, encoding="utf-8")
        path = folder / "scene.yaml"
        path.write_text(json.dumps(data | scenario), encoding="utf-8")  # JSON is YAML
        return uninterrupted(prepare(path).run())


def vector(values: Sequence[float] | FloatArray) -> str:
    """Numbers as MJCF has them."""
    return " ".join(repr(float(value)) for value in values)


def model(body: str, *, gravity: Sequence[float] = (0.0, 0.0, 0.0), more: str = "") -> str:
    """MJCF of some bodies under uniform gravity, m/s^2."""
    return f'<mujoco><option gravity="{vector(gravity)}"/><worldbody>{body}</worldbody>{more}</mujoco>'


def body(
    name: str,
    mass: float,
    moments: Sequence[float],
    content: str = "",
    *,
    joint: str = FREE,
    at: Sequence[float] | FloatArray = (0.0, 0.0, 0.0),
    centre: Sequence[float] = (0.0, 0.0, 0.0),
    geom: str = 'size="0.01"',
) -> str:
    """Body with its moments of inertia about the mass centre, a geom of its name without mass, and further content."""
    return f"""<body name="{name}" pos="{vector(at)}">{joint}
      <inertial pos="{vector(centre)}" mass="{mass!r}" diaginertia="{vector(moments)}"/>
      <geom name="{name}" {geom} mass="0"/>{content}</body>"""


def ball(name: str, mass: float, radius: float, *, joint: str = FREE, at: Sequence[float] = (0.0, 0.0, 0.0)) -> str:
    """Body with the geom and the inertia of a uniform sphere."""
    return body(name, mass, [0.4 * mass * radius**2] * 3, joint=joint, at=at, geom=f'type="sphere" size="{radius!r}"')


def box(name: str, mass: float, half: Sequence[float], *, joint: str = FREE, at: Sequence[float] = (0.0, 0.0, 0.0)) -> str:
    """Body with the geom and the inertia of a uniform box."""
    x, y, z = ((2.0 * length) ** 2 for length in half)
    moments = [mass / 12.0 * (y + z), mass / 12.0 * (x + z), mass / 12.0 * (x + y)]
    return body(name, mass, moments, joint=joint, at=at, geom=f'type="box" size="{vector(half)}"')


def rock(gravity: Sequence[float] = (0.0, 0.0, 0.0)) -> dict[str, str]:
    """A free object far away: a scene has one."""
    return {"rock": model(ball("rock", 1.0, 0.1, at=(90, 0, 0)), gravity=gravity)}


def ground() -> str:
    """Geom of a fixed slab whose top is z = 0."""
    return '<geom name="ground" type="box" size="50 50 0.5" pos="0 0 -0.5"/>'


def slide(name: str, axis: str) -> str:
    """MJCF of a joint along an axis."""
    return f'<joint name="{name}" type="slide" axis="{axis}"/>'


def slides(axes: str) -> str:
    """MJCF of joints along axes of the world, named ``x``, ``y`` and ``z``."""
    return "".join(slide(axis, vector([float(axis == letter) for letter in "xyz"])) for axis in axes)


def motors(*joints: str) -> str:
    """MJCF of motors with the names of their joints."""
    parts = (f'<motor name="{joint}" joint="{joint}"/>' for joint in joints)
    return f"<actuator>{''.join(parts)}</actuator>"


def throughout(**laws: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One phase with control laws by the names of their parts."""
    return [{"name": "all", "until": "end", "controllers": laws}]


def rule(one: str, other: str, restitution: float, mu: float = 0.0, name: str = "") -> dict[str, Any]:
    """Contact rule of two geoms."""
    keys = ({"mu": mu} if mu else {}) | ({"name": name} if name else {})
    return {"between": [one, other], "restitution": restitution} | keys


def touching(*rules: Mapping[str, Any]) -> dict[str, Any]:
    """Key ``contacts`` of a scenario with these rules."""
    return {"rules": list(rules)}


def times(step_s: float, duration_s: float) -> dict[str, Any]:
    """Keys of a scenario with a control tick at every step."""
    return {"time_step_s": step_s, "control_period_s": step_s, "duration_s": duration_s}


def states(run: Run, column: str) -> FloatArray:
    """States whose columns begin so, shape (samples, coordinates)."""
    keys = [key for key in run.keys if key.startswith(f"state.{column}")]
    if not keys:
        raise KeyError(column)
    return np.column_stack([run[key] for key in keys])


def final(run: Run, column: str) -> FloatArray:
    """Last of these states."""
    return np.asarray(states(run, column)[-1])


def text_of(value: float, digits: int = 12) -> str:
    """A number of a closed form, to significant digits."""
    if not math.isfinite(value):
        raise ValueError(value)
    return f"{value:.{digits}g}"
