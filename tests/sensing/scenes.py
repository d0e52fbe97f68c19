"""An arm with sensors that pushes against a box."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import ffsm_mj
from ffsm_mj.controller_protocol import Command, Observation, StrictModel
from tests.laws import Law
from tests.scenes import HEAD, box, scene

SENSORS = """
  <jointpos name="encoder" joint="j1" noise="0.001"/>
  <gyro name="gyro" site="imu" interval="0.01"/>
  <accelerometer name="acc" site="imu" interval="0.0033"/>
  <force name="force" site="wrist" interval="0.0033"/>
  <torque name="torque" site="wrist" interval="0.0033"/>
  <touch name="pad" site="pad" interval="0.0033"/>
  <framepos name="camera" objtype="xbody" objname="hand" reftype="site" refname="imu" interval="0.1" delay="0.1"/>
  <framequat name="attitude" objtype="site" objname="imu"/>
"""


def arm(sensors: str = SENSORS) -> str:
    """MJCF of a floating base with two joints and a hand."""
    return f"""<mujoco>{HEAD}<worldbody>
      <body name="base"><freejoint name="base"/>
        <geom name="hull" type="box" size=".3 .3 .3" mass="50"/>
        <site name="imu" pos=".1 .05 .02" euler="1 2 3"/>
        <body name="link" pos=".3 0 0"><joint name="j1" axis="0 1 0"/>
          <geom name="link" type="capsule" size=".05" fromto="0 0 0 .5 0 0" mass="3"/>
          <body name="hand" pos=".5 0 0"><joint name="j2" axis="0 0 1"/>
            <site name="wrist"/>
            <geom name="tip" type="sphere" size=".08" pos=".2 0 0" mass="1"/>
            <site name="pad" type="sphere" size=".2" pos=".2 0 0"/>
          </body></body></body></worldbody>
      <actuator><motor name="m1" joint="j1"/><motor name="m2" joint="j2"/><motor name="push" site="imu" gear="1 0 0 0 0 0"/>
      </actuator><sensor>{sensors}</sensor></mujoco>"""


class Listener(Law):
    """A law with given efforts that keeps what it is shown of measurements."""

    class Config(StrictModel):
        """Efforts of the three actuators."""

        kind: Literal["listen"]
        efforts: tuple[float, float, float] = (0.2, 0.02, 6.0)

    shown: list[Observation]

    def __init__(self, config: Any, context: Any) -> None:
        self._efforts = config.efforts
        type(self).shown = []

    def control(self, observation: Observation, command: Command) -> None:
        """Constant efforts."""
        command.effort[:], command.powered[:] = self._efforts, True
        type(self).shown.append(observation)


def pushing(folder: Path, *, robot: str = "", law: dict[str, Any] | None = None, **scenario: Any) -> Path:
    """A scenario: the arm moves towards a light box that comes closer, and pushes it on."""
    return scene(
        folder,
        robot or arm(),
        {"b": box("b", mass=5.0, half=(0.2, 1.2, 1.2))},
        **{
            "duration_s": 0.5,
            "time_step_s": 0.002,
            "control_period_s": 0.01,
            "initial": {
                "joints": {"b/free": [1.35, 0.03, 0.02, 1, 0, 0, 0], "j1": 0.05},
                "rates": {"j1": 0.3, "j2": 0.2, "base": [0.1, 0, 0, 0.1, 0.2, 0.3], "b/free": [-0.3, 0.05, 0, 0, 0, 0]},
            },
            "contacts": {"rules": [{"between": ["robot", "b"], "restitution": 0.0}]},
            "phases": [{"name": "push", "until": "end", "controller": {"kind": "listen", **(law or {})}}],
            **scenario,
        },
    )


def run(path: Path, **options: Any) -> ffsm_mj.Run:
    """Run with the law above."""
    return ffsm_mj.run(path, controllers={"listen": Listener}, **options)


def column(run: ffsm_mj.Run, key: str) -> Any:
    """Values of a column of a run."""
    return run.log.rows[:, run.log.header.layout.index[key]]
