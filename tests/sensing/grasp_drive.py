"""A filter without the simulator through a grasp: the truth is caught, held and let go at given ticks."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import mujoco

from ffsm_controllers.estimators import estimators
from ffsm_controllers.estimators.mekf.estimator import Mekf
from ffsm_mj.contact_models.grasp.grasped_motion import GraspedMotion
from ffsm_mj.contact_models.grasp.latch_joints import plastic_impulse
from ffsm_mj.contact_models.grasp.records import GraspRecord, ReleaseRecord
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.controller_protocol import ControllerContext, Sensor, System, predict
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.sensors import AddedSensor
from ffsm_mj.sensing.config import SensorConfig
from ffsm_mj.sensing.sensor import sensors_of
from tests.contact_models.grasp.scenes import ARM, TARGET
from tests.sensing.filter_drive import INITIAL, PERIOD_S, PROCESS, Drive, Truth

SENSORS = """<sensor><framepos name="place" objtype="xbody" objname="base"/>
  <framequat name="stars" objtype="xbody" objname="base"/><gyro name="gyro" site="imu"/>
  <jointpos name="q1" joint="shoulder"/><jointpos name="q2" joint="elbow"/>
  <jointvel name="v1" joint="shoulder"/><jointvel name="v2" joint="elbow"/></sensor></mujoco>"""
NOISE = {
    "place": {"noise": 0.01, "interval_s": 0.2},
    "stars": {"noise": 0.002, "interval_s": 0.2},
    "gyro": {"noise": 0.001},
    "sees": {"noise": 0.005, "interval_s": 0.1},
    "turned": {"noise": 0.01, "interval_s": 0.1},
}
GRASP = Grasp("grasp", "robot/grip", "target/handle", "robot/hand", "target", "target/target")
EFFORTS = (0.05, -0.04)


def arm_and_target(folder: Path) -> tuple[System, System]:
    """A floating arm that measures itself and sees a target: the scene, and the same with the target in its hand."""
    robot = ARM.replace('<body name="upper"', '<site name="imu" pos=".1 0 0"/><body name="upper"')
    (folder / "robot.xml").write_text(robot.replace("</mujoco>", SENSORS))
    (folder / "target.xml").write_text(TARGET)
    files = read_model(folder / "robot.xml"), {"target": read_model(folder / "target.xml")}
    added = [AddedSensor(name, kind, "target/target", "grip") for name, kind in CAMERA.items()]
    free, held = (compile_system(*files, time_step_s=0.01, sensors=added, grasp=grasp) for grasp in (None, GRASP))
    return free, held


CAMERA = {"sees": "framepos", "turned": "framequat"}


def sensors_of_arm(system: System, **camera: Any) -> dict[str, Sensor]:
    """The sensors with their errors; ``camera`` holds for those of the camera."""
    configs = {name: SensorConfig(**{**given, **(camera if name in CAMERA else {})}) for name, given in NOISE.items()}
    return {sensor.name: sensor for sensor in sensors_of(system, configs, PERIOD_S, 10.0)}


def grasp_filter(system: System, sensors: dict[str, Sensor], grasped: dict[str, System], **config: Any) -> Mekf:
    """The filter, which knows the systems with a grasped object."""
    built = estimators().classes["mekf"]
    settings = built.Config(**{"kind": "mekf", "initial": INITIAL, "process": PROCESS, **config})
    made = built(settings, ControllerContext(system, None, PERIOD_S, sensors=sensors, grasped=grasped))
    assert isinstance(made, Mekf)
    return made


class CaughtTruth(Truth):
    """The truth, whose target can be caught where it is, under constant efforts.

    Attributes:
        held: Its motion while the target is held.
        is_held: Whether it is.
    """

    def __init__(self, free: System, grasped: System, sensors: dict[str, Sensor], seed: int, process: dict[str, float]):
        super().__init__(free, sensors, seed, process)
        arm = {"robot/shoulder": (0.3, 0.2), "robot/elbow": (-0.4, -0.1)}
        for name, (angle, rate) in arm.items():
            self.data.qpos[free.joints[name].qpos], self.data.qvel[free.joints[name].dofs] = angle, rate
        target = free.trees[1].joints[0]
        self.data.qpos[target.qpos][:3] = (1.0, 0.15, 0.2)
        self.data.qvel[target.dofs] = (-0.1, 0.05, 0.1, 0.3, 0.2, -0.4)
        self.data.ctrl[:] = EFFORTS
        mujoco.mj_forward(self.model, self.data)
        self.held = GraspedMotion(Motion(free.mj, self.data), Scene(free, self.data), grasped.copy(), GRASP)
        self.is_held = False

    def catch(self, time_s: float) -> GraspRecord:
        """Catch the target."""
        mujoco.mj_forward(self.model, self.data)
        bodies = [int(self.model.body(name).id) for name in (GRASP.link, GRASP.root)]
        self.data.qvel[:] += plastic_impulse(self.model, self.data, *bodies, self.data.xpos[bodies[1]].copy()).change
        mujoco.mj_forward(self.model, self.data)
        self.held.hold()
        self.is_held = True
        pose = self.held.model.body_pos[self.held.root], self.held.model.body_quat[self.held.root]
        known = {"time_s": time_s, "grasp": "grasp", "place": 1}
        known |= {"object_position_m": tuple(pose[0]), "object_quaternion": tuple(pose[1])}
        return GraspRecord(**{field.name: known.get(field.name) for field in fields(GraspRecord)})

    def let_go(self, time_s: float) -> ReleaseRecord:
        """Let the target go."""
        self.is_held = False
        known = {"time_s": time_s, "grasp": "grasp"}
        return ReleaseRecord(**{field.name: known.get(field.name) for field in fields(ReleaseRecord)})

    def move(self, duration_s: float) -> None:
        """Move on, with the pushes on the base while the target is held."""
        if not self.is_held:
            super().move(duration_s)
            return
        held = self.held
        held.sync_from_system()
        predict(held.model, held.data, duration_s)
        self.push(held.model, held.data, [held.system.robot.joints[0]], duration_s)
        mujoco.mj_forward(held.model, held.data)
        held.follow()


class CaughtDrive(Drive):
    """A truth that is caught and let go, with a filter that follows it."""

    def __init__(self, free: System, grasped: System, sensors: dict[str, Sensor], made: Mekf, seed: int, **options: Any):
        super().__init__(
            free,
            sensors,
            made,
            seed,
            truth=CaughtTruth(free, grasped, sensors, seed, options.pop("process", PROCESS)),
            **options,
        )
        self.estimate.ctrl[:] = EFFORTS
        made.start(self.estimate)

    def through(self, caught: int, let_go: int, ticks: int, on_tick: Any = lambda _: None) -> None:
        """Run for some periods; the target is caught and let go at given ones."""
        truth, events = self.truth, []

        def grasp(time_s: float) -> None:
            tick = round(time_s / PERIOD_S)
            on_tick(time_s)
            if tick == caught:
                events.append(truth.catch(time_s))
            elif tick == let_go:
                events.append(truth.let_go(time_s))
            else:
                return
            self.made.update(time_s, self.truth.measured(time_s), events[-1:], self.estimate)

        self.run(ticks, grasp)
