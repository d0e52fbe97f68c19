"""Sensors of random scenes: every kind that can be measured, with errors, rates and delays, and what laws are told."""

from __future__ import annotations

from typing import Any

from tests.random_scenes.dice import Dice
from tests.random_scenes.models import Model

FRAMES = (
    *("framepos", "framequat", "framexaxis", "frameyaxis", "framezaxis"),
    *("framelinvel", "frameangvel", "framelinacc", "frameangacc"),
)
ON_SITES = ("gyro", "accelerometer", "velocimeter", "force", "torque", "touch", "magnetometer", "rangefinder")
OF_SUBTREES = ("subtreecom", "subtreelinvel", "subtreeangmom")
ADDED = ("framepos", "framequat", "framelinvel", "frameangvel")
RATES = {"gyro": 3, "velocimeter": 3, "frameangvel": 3, "framelinvel": 3}


class SensorDrawing:
    """Draws sensors of the robot's file and their configuration."""

    def __init__(self, seed: int, robot: Model, objects: dict[str, Model], period_s: float) -> None:
        self.dice, self.robot, self.objects, self.period_s = Dice(seed, "sensors"), robot, objects, period_s
        self.measures = self.dice.chance(0.5)
        self.xml = ""
        self.config: dict[str, Any] = {}
        self.ends: list[dict[str, Any]] = []
        """Ends of phases at measurements."""
        self.estimator: dict[str, Any] | None = None

    def draw(self) -> None:
        if not self.measures:
            return
        dice, robot = self.dice, self.robot
        sites = ["imu", *robot.tips]
        known = [*((kind, "site") for kind in ON_SITES), *((kind, "frame") for kind in FRAMES)]
        known += [(kind, "subtree") for kind in OF_SUBTREES]
        known += [("jointpos", "joint"), ("jointvel", "joint"), ("clock", ""), ("e_kinetic", "")]
        known += [(kind, "actuator") for kind in ("actuatorpos", "actuatorvel", "actuatorfrc")]
        known += [("jointactuatorfrc", "joint")]
        known += [("ballquat", "ball"), ("ballangvel", "ball")] if robot.base == "ball" else []
        chosen = dice.some(known, 10)
        for kind, where in chosen:
            name = f"{kind}_s"
            if where in ("joint", "actuator"):
                actuators = [each.name for each in robot.actuators if each.kind == "joint"]
                elements = robot.joints if where == "joint" else actuators
                if not elements:
                    continue
                place = f'{where}="{dice.pick(elements)}"'
            else:
                place = {
                    "site": f'site="{dice.pick(sites)}"',
                    "frame": f'objtype="site" objname="{dice.pick(sites)}"',
                    "subtree": 'body="base"',
                    "ball": 'joint="ball"',
                    "": "",
                }[where]
            self.xml += f'<{kind} name="{name}" {place}/>'
            if dice.chance(0.7):
                self.config[name] = self._errors(kind)
        for name in self.objects:
            if dice.chance(0.3):
                kind = dice.pick(ADDED)
                self.config[f"camera_{name}"] = {
                    "kind": kind,
                    "of": f"{name}/handle",
                    "relative_to": dice.pick(sites),
                    **self._errors(kind),
                }
                if dice.chance(0.3):
                    self.config[f"camera_{name}"]["field_of_view"] = {
                        "half_angle_rad": dice.between(0.2, 3.0),
                        "site": dice.pick(robot.tips),
                        "axis": dice.pick(["x", "y", "z", "-x", "-y", "-z"]),
                    }
                    self.config[f"camera_{name}"]["occlusion"] = dice.chance(0.5)

        if any(kind in ("gyro", "accelerometer", "force") for kind, _ in chosen):
            kind = next(kind for kind, _ in chosen if kind in ("gyro", "accelerometer", "force"))
            self.ends.append({"sensor": f"{kind}_s", "above": dice.log_between(0.05, 5.0)})
        self._estimate()

    def _estimate(self) -> None:
        """An estimator that has all that it needs: poses of all floating bodies, and joints."""
        dice, robot = self.dice, self.robot
        spatial = robot.base == "free" and all(model.base == "free" for model in self.objects.values())
        if not (spatial and dice.chance(0.2)):
            return
        errors = {"noise": 1e-3, "interval_s": 2 * self.period_s, "delay_s": dice.pick([0.0, 0.7 * self.period_s])}
        for of in ("imu", *(f"{name}/handle" for name in self.objects)):
            for kind in ("framepos", "framequat"):
                self.config[f"{kind}_of_{of.replace('/', '_')}"] = {"kind": kind, "of": of, **errors}
        for joint in robot.joints:
            self.config[f"angle_{joint}"] = {"kind": "jointpos", "of": joint, "quantum": 1e-4}
        self.estimator = {"kind": dice.pick(["direct", "mekf"])}

    def _errors(self, kind: str) -> dict[str, Any]:
        dice, config = self.dice, {}
        if dice.chance(0.5):
            config["interval_s"] = dice.pick([self.period_s, 2 * self.period_s, dice.between(0.5, 5.0) * self.period_s])
            config["first_s"] = dice.pick([0.0, dice.between(0.0, 2.0) * self.period_s])
        if dice.chance(0.5):
            config["delay_s"] = dice.pick([self.period_s, dice.between(0.1, 6.0) * self.period_s])
            config["delay_jitter_s"] = dice.pick([0.0, dice.between(0.0, 3.0) * self.period_s])
        if kind == "clock":
            return config
        unit = "quat" in kind or "axis" in kind  # values of unit length have rotations as errors
        if dice.chance(0.4):
            config[dice.pick(["noise", "noise_density"])] = 1e-3
        if dice.chance(0.3):
            config["bias"], config["bias_walk"] = 0.01, dice.pick([0.0, 1e-3])
            config |= {} if unit else {"scale_error": 0.001}
        if dice.chance(0.2) and kind in (*RATES, "force", "torque", "accelerometer"):
            config["misalignment_rad"] = dice.vector(0.02)
        if dice.chance(0.2) and not unit:
            config["quantum"] = 1e-3
        if dice.chance(0.2) and not unit:
            config["cutoff"] = 2.0
        if dice.chance(0.2):
            config["dropout"] = dice.pick([0.1, 0.5])
        return config

    @property
    def most_grasps(self) -> int:
        """A Kalman filter knows one closed grasp at a time, and ends the run at a further one."""
        return 1 if self.estimator and self.estimator["kind"] == "mekf" else 2

    @property
    def filled(self) -> str:
        """The element of the robot's file."""
        return f"<sensor>{self.xml}</sensor>" if self.xml else ""

    def scenario(self, seed: int) -> dict[str, Any]:
        """Keys of the scenario."""
        if not self.measures:
            return {}
        said: dict[str, Any] = {"sensors": self.config, "seed": seed}
        if self.estimator:
            said["estimator"] = self.estimator
        if self.dice.chance(0.2):
            said["impact_feedback"] = self.dice.pick([False, {"min_impulse_N_s": self.dice.log_between(0.01, 1.0)}])
        return said
