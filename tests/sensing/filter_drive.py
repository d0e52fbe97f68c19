"""A filter without the simulator: the truth by free motion with random pushes, measurements by the classes of sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.estimators import estimators
from ffsm_controllers.estimators.mekf.estimator import Mekf
from ffsm_mj.controller_protocol import ControllerContext, Measurement, Sensor, System, predict
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from ffsm_mj.model.sensors import AddedSensor
from ffsm_mj.sensing.config import SensorConfig
from ffsm_mj.sensing.group import SensorGroup
from ffsm_mj.sensing.measured import Measured, places_of
from ffsm_mj.sensing.sensor import sensors_of
from tests.scenes import HEAD, box

PERIOD_S = 0.05
SATELLITE = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="base"/>
  <inertial pos=".02 -.01 .03" mass="50" diaginertia="3 4 5"/><geom type="box" size=".3 .3 .3" mass="0"/>
  <site name="imu" pos=".1 .05 .02" euler="10 20 30"/><site name="eye" pos=".3 .1 0" euler="0 60 15"/></body></worldbody>
  <actuator><motor name="push" site="eye" gear="1 0 0 0 0 0"/></actuator>
  <sensor><framepos name="place" objtype="site" objname="imu"/><framequat name="stars" objtype="site" objname="imu"/>
  <gyro name="gyro" site="imu"/></sensor></mujoco>"""
NOISE = {
    "place": {"noise": 0.01, "interval_s": 0.2},
    "stars": {"noise": 0.002, "interval_s": 0.2},
    "gyro": {"noise": 0.001},
}
CAMERA = {
    "sees": ("framepos", {"noise": 0.005, "interval_s": 0.1}),
    "turned": ("framequat", {"noise": 0.01, "interval_s": 0.1}),
}
INITIAL = {"position_m": 0.05, "attitude_rad": 0.05, "velocity_m_s": 0.02, "rate_rad_s": 0.02}
PROCESS = {"acceleration_density": 0.002, "angular_acceleration_density": 0.002}
TWISTS = (np.array([0.1, 0.0, 0.05, 0.1, -0.2, 0.15]), np.array([-0.1, 0.05, 0.1, 0.3, 0.5, -0.4]))


def satellites(folder: Path, camera: dict[str, Any] = CAMERA, robot: str = SATELLITE) -> System:
    """A base with its own sensors and a camera that looks at a box, relative to which nothing but the camera measures."""
    (folder / "robot.xml").write_text(robot)
    (folder / "b.xml").write_text(box("b", mass=5.0, half=(0.2, 0.3, 0.5)))
    added = [AddedSensor(name, kind, "b/b", "eye") for name, (kind, _) in camera.items()]
    return compile_system(
        read_model(folder / "robot.xml"), {"b": read_model(folder / "b.xml")}, time_step_s=0.01, sensors=added
    )


def sensors_in(system: System, camera: dict[str, Any] = CAMERA, **more: Any) -> dict[str, Sensor]:
    """The sensors with their errors; ``more`` holds for those of the camera."""
    configs = {name: SensorConfig(**given) for name, given in NOISE.items()}
    configs |= {name: SensorConfig(**{**given, **more}) for name, (_, given) in camera.items()}
    return {sensor.name: sensor for sensor in sensors_of(system, configs, PERIOD_S, 10.0)}


def filter_of(system: System, sensors: dict[str, Sensor], **config: Any) -> Mekf:
    """The filter, with initial deviations and process noise as above unless stated."""
    built = estimators().classes["mekf"]
    settings = built.Config(**{"kind": "mekf", "initial": INITIAL, "process": PROCESS, **config})
    made = built(settings, ControllerContext(system, None, PERIOD_S, sensors=sensors))
    assert isinstance(made, Mekf)
    return made


def noiseless(sensors: dict[str, Sensor]) -> dict[str, Sensor]:
    """The same sensors without noise."""
    return {name: replace(sensor, noise=0.0 * sensor.noise) for name, sensor in sensors.items()}


class Truth:
    """The true motion, with random pushes, and its sensors."""

    def __init__(self, system: System, sensors: dict[str, Sensor], seed: int, process: dict[str, float]) -> None:
        """At a start of its own: the box two metres in front of the base, both turning."""
        self.model, self.data = system.mj, mujoco.MjData(system.mj)
        self.random = np.random.default_rng(seed)
        self.joints = [tree.joints[0] for tree in system.trees]
        for joint, twist, place in zip(self.joints, TWISTS, ((0, 0, 0), (2.0, 0.3, -0.2)), strict=True):
            self.data.qpos[joint.qpos] = (*place, 1.0, 0.0, 0.0, 0.0)
            self.data.qvel[joint.dofs] = twist
        self._groups = [SensorGroup([sensor], seed) for sensor in sensors.values()]
        self._places = places_of(self._groups)
        densities = process["acceleration_density"], process["angular_acceleration_density"]
        self._push = np.repeat(densities, 3)

    def begin(self) -> None:
        """Take the samples of the beginning."""
        for group in self._groups:
            group.begin()
        self._sample(0.0)

    def advance(self, time_s: float) -> None:
        """Move on by a period, and take the samples at its end."""
        self.move(PERIOD_S)
        self._sample(time_s)

    def move(self, duration_s: float) -> None:
        """Move on, with the pushes."""
        predict(self.model, self.data, duration_s)
        self.push(self.model, self.data, self.joints, duration_s)

    def push(self, model: Any, data: Any, joints: Sequence[Any], duration_s: float) -> None:
        """Add what white noise of the accelerations of floating bodies does in a time."""
        walk = np.zeros(model.nv)
        for joint in joints:
            of_rate, of_integral = self.random.standard_normal((2, 6))
            data.qvel[joint.dofs] += self._push * duration_s**0.5 * of_rate
            walk[joint.dofs] = self._push * duration_s**1.5 * (of_rate / 2.0 + of_integral / 12.0**0.5)
        mujoco.mj_integratePos(model, data.qpos, walk, 1.0)

    def _sample(self, time_s: float) -> None:
        self.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        mujoco.mj_forward(self.model, self.data)
        for group in self._groups:
            while group.next_s <= time_s + 1e-9:
                group.take(self.data.sensor(group.sensors[0].name).data)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)

    def measured(self, time_s: float) -> dict[str, Measurement]:
        """Newest samples that have arrived."""
        for group in self._groups:
            group.arrive(time_s)
        return dict(Measured(self._places, tuple(group.shown for group in self._groups), time_s))


def moved(system: System, data: Any, error: np.ndarray) -> Any:
    """A copy of a state moved by an error, six of coordinates and six of rates for each body."""
    made = mujoco.MjData(system.mj)
    made.qpos[:], made.qvel[:] = data.qpos, data.qvel
    for tree, part in zip(system.trees, error.reshape(-1, 12), strict=True):
        joint = tree.joints[0]
        made.qpos[joint.qpos][:3] += part[:3]
        mujoco.mju_quatIntegrate(made.qpos[joint.qpos][3:], part[3:6], 1.0)
        made.qvel[joint.dofs] += part[6:]
    return made


def error_of(system: System, truth: Any, estimate: Any) -> np.ndarray:
    """Error of each body, true less estimated, (bodies, 12)."""
    apart = np.empty(system.mj.nv)
    mujoco.mj_differentiatePos(system.mj, apart, 1.0, estimate.qpos, truth.qpos)
    joints = [tree.joints[0] for tree in system.trees]
    return np.array([np.concatenate((apart[j.dofs], truth.qvel[j.dofs] - estimate.qvel[j.dofs])) for j in joints])


class Drive:
    """A truth with a filter that follows it.

    Attributes:
        truth: The truth.
        made: The filter.
        estimate: MuJoCo data with its estimate.
    """

    def __init__(self, system: System, sensors: dict[str, Sensor], made: Mekf, seed: int, **options: Any) -> None:
        """Begin with an initial error: by default drawn with the standard deviations of ``INITIAL``."""
        self.system, self.made = system, made
        self.truth = options.get("truth") or Truth(system, sensors, seed, options.get("process", PROCESS))
        deviations = np.tile(np.repeat(list(INITIAL.values()), 3), len(system.trees))
        error = options.get("error", deviations * self.truth.random.standard_normal(len(deviations)))
        self.estimate = moved(system, self.truth.data, -np.asarray(error))
        made.start(self.estimate)

    def run(self, ticks: int, on_tick: Callable[[float], None] = lambda _: None, events: Sequence[Any] = ()) -> None:
        """Run for some periods from the beginning; ``on_tick`` is called with the time after each."""
        self.truth.begin()
        for tick in range(ticks + 1):
            time_s = tick * PERIOD_S
            if tick:
                self.truth.advance(time_s)
            told = [event for event in events if time_s - PERIOD_S < event.time_s <= time_s]
            self.made.update(time_s, self.truth.measured(time_s), told, self.estimate)
            self.estimate.time = time_s
            on_tick(time_s)

    def error(self) -> np.ndarray:
        """Error of each body, true less estimated, (bodies, 12)."""
        return error_of(self.system, self.truth.data, self.estimate)

    def nees(self) -> np.ndarray:
        """Normalised estimation error squared of each body, (bodies,)."""
        names = [tree.name for tree in self.system.trees]
        errors = self.error()
        return np.array([e @ np.linalg.solve(self.made.covariance(n), e) for n, e in zip(names, errors, strict=True)])
