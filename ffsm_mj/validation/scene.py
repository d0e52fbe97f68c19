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
        for each, text in {f"{name}.xml": mjcf for name, mjcf in models.items()}.items() | (files or {}).items():
            (folder / each).write_text(text, encoding="utf-8")
        path = folder / "scene.yaml"
        path.write_text(json.dumps(data | scenario), encoding="utf-8")  # JSON is YAML
        return uninterrupted(prepare(path).run())


def model(body: str, *, gravity: Sequence[float] = (0.0, 0.0, 0.0), more: str = "") -> str:
    """MJCF of some bodies under uniform gravity, m/s^2."""
    return f'<mujoco><option gravity="{_text(gravity)}"/><worldbody>{body}</worldbody>{more}</mujoco>'


def ball(
    name: str,
    mass: float,
    radius: float,
    *,
    joint: str = '<freejoint name="free"/>',
    at: Sequence[float] = (0.0, 0.0, 0.0),
) -> str:
    """Body with the geom and the inertia of a uniform sphere."""
    inertia = 0.4 * mass * radius**2
    return f"""<body name="{name}" pos="{_text(at)}">{joint}
      <inertial pos="0 0 0" mass="{mass!r}" diaginertia="{_text([inertia] * 3)}"/>
      <geom name="{name}" type="sphere" size="{radius!r}" mass="0"/></body>"""


def box(
    name: str,
    mass: float,
    half: Sequence[float],
    *,
    joint: str = '<freejoint name="free"/>',
    at: Sequence[float] = (0, 0, 0),
) -> str:
    """Body with the geom and the inertia of a uniform box."""
    x, y, z = ((2.0 * each) ** 2 for each in half)
    inertia = [mass / 12.0 * (y + z), mass / 12.0 * (x + z), mass / 12.0 * (x + y)]
    return f"""<body name="{name}" pos="{_text(at)}">{joint}
      <inertial pos="0 0 0" mass="{mass!r}" diaginertia="{_text(inertia)}"/>
      <geom name="{name}" type="box" size="{_text(half)}" mass="0"/></body>"""


def ground() -> str:
    """Geom of a fixed slab whose top is z = 0."""
    return '<geom name="ground" type="box" size="50 50 0.5" pos="0 0 -0.5"/>'


def slide(name: str, axis: str) -> str:
    """MJCF of a joint along an axis."""
    return f'<joint name="{name}" type="slide" axis="{axis}"/>'


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


def _text(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
