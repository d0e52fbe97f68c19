"""A random scene of a seed: models, placement, contacts, actuation, sensing, laws and phases, written as a scenario."""

from __future__ import annotations

import json
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tests.random_scenes.dice import Dice
from tests.random_scenes.laws import LawDrawing, PhaseDrawing
from tests.random_scenes.models import BASES, ModelDrawing
from tests.random_scenes.pieces import WELD_M
from tests.random_scenes.placement import Stage
from tests.random_scenes.sensing import SensorDrawing

STEPS_S = (5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
RESTITUTIONS = (0.0, 0.0, 0.0, 0.3, 0.5, 0.8, 0.95, 1.0)


def draw(seed: int, folder: Path, *, whole: bool = False) -> Path:
    """Write the scene of a seed; returns the path of its scenario. With ``whole`` no body is of several pieces."""
    return _Scene(seed, folder, whole=whole).written()


class _Scene:
    def __init__(self, seed: int, folder: Path, *, whole: bool) -> None:
        self.seed, self.folder, self.whole = seed, folder, whole
        dice = Dice(seed, "scene")
        self.step_s = dice.pick(STEPS_S)
        self.period_s = self.step_s * dice.pick([1, 1, 1, 2, 5])
        length = min(1.0, dice.log_between(40.0, 250.0) * self.step_s)
        self.duration_s = max(2, round(length / self.period_s)) * self.period_s
        self.presses = dice.chance(0.5)
        self.base = dice.pick(BASES)
        self.flat = self.base == "planar" and dice.chance(0.5)
        self.count = dice.integer(1, 3)
        self.wall = dice.chance(0.3)
        self.rough = dice.chance(0.5)
        self.accuracy = dice.chance(0.2)
        self.aligned = Dice(seed, "alignment").chance(0.25)
        gravity = Dice(seed, "gravity")
        self.gravity = np.zeros(3)
        if gravity.chance(0.25):
            way = np.array([1.0, 0.0, 0.0]) if self.wall or self.flat else np.array(gravity.direction())
            self.gravity = gravity.pick([0.1, 1.0, 9.81]) * way
        self.turn = np.array([1.0, 0.0, 0.0, 0.0])
        self.boost = np.zeros(3)
        frame = Dice(seed, "frame")
        if self.base == "free" and not self.flat and frame.chance(0.6):
            self.turn = np.array(frame.turn())
        if not self.wall and self.base != "ball" and frame.chance(0.3):
            self.boost = np.array(frame.vector(1.0)) * ([1, 1, 0] if self.base == "planar" else [1, 1, 1])

    def written(self) -> Path:
        frame = Rotation.from_quat(self.turn, scalar_first=True)
        gravity = frame.apply(self.gravity)
        models = ModelDrawing(
            self.seed, self.step_s, gravity.tolist(), presses=self.presses, flat=self.flat, aligned=self.aligned
        )
        models.cut = models.cut and not self.whole
        self.robot = models.robot(self.base)
        dice = Dice(self.seed, "objects")
        kinds = ["planar"] if self.flat else ["free"] * 4 + (["planar"] if self.base == "planar" else [])
        self.objects = {f"o{i}": models.object(f"o{i}", dice.pick(kinds)) for i in range(self.count)}
        sensing = SensorDrawing(self.seed, self.robot, self.objects, self.period_s)
        sensing.draw()
        robot_xml = self.robot.xml.replace("SENSORS", sensing.filled)
        texts = {name: made.xml for name, made in self.objects.items()}
        keys = {name: model.keys for name, model in self.objects.items()}
        if self.wall:
            wall = models.wall("wall")
            texts["wall"], keys["wall"], self.wall_side = wall.xml, wall.keys, wall.side
        for name, text in {"robot": robot_xml, **texts}.items():
            (self.folder / f"{name}.xml").write_text(text)
        apart = texts | ({"wall": wall.apart} if self.wall else {})
        stage = Stage(self.robot.xml.replace("SENSORS", ""), apart, gravity)
        contacts = self._contacts() | ({"weld_m": WELD_M} if models.cut else {})
        initial, poses = self._start(stage)
        times = (self.step_s, self.period_s, self.duration_s)
        laws = LawDrawing(
            self.seed, self.robot, self.objects, times, presses=self.presses, flat=self.flat, folder=self.folder
        )
        laws.tips = self.tips
        data: dict[str, Any] = {
            "name": f"random-{self.seed}",
            "duration_s": self.duration_s,
            "time_step_s": self.step_s,
            "control_period_s": self.period_s,
            "conservative": not self.gravity.any(),
            "robot": {"mjcf": "robot.xml", **self.robot.keys},
            "objects": {
                name: {"mjcf": f"{name}.xml"} | keys[name] | ({"fixed": True, "pose": poses[name]} if name in poses else {})
                for name in texts
            },
            "initial": initial,
            "contacts": contacts,
            **PhaseDrawing(self.seed, laws, self.rule_names, sensing.ends, sensing.most_grasps).scenario(),
            **sensing.scenario(self.seed),
            **self._actuation(laws),
            **self._impacts(contacts),
            **self._variations(sensing),
        }
        if self.accuracy:
            data["accuracy"] = Dice(self.seed, "accuracy").pick([1e-9, 1e-9, 1e-7])
        path = self.folder / "scene.yaml"
        path.write_text(json.dumps(data, indent=1))  # JSON is YAML
        return path

    def _contacts(self) -> dict[str, Any]:
        """Rules by pairs of geoms, by models, or one default for all."""
        dice = Dice(self.seed, "contacts")
        usual = 0.0 if self.presses else dice.pick(RESTITUTIONS)
        style = dice.pick(["geoms"] * 7 + ["models", "models", "default"])
        said: dict[str, Any] = {"ignored": [{"between": ["robot", "self"], "reason": "an arm may lie across itself"}]}
        if style == "default":
            self.rule_names = [f"robot-{name}" for name in self.objects]
            return said | {"default": self._surface(dice, usual)}
        names = {"robot": ["robot"]} if style == "models" else {"robot": [f"robot/{geom}" for geom in self.robot.geoms]}
        for name, model in self.objects.items():
            names[name] = [name] if style == "models" else [f"{name}/{geom}" for geom in model.geoms]
        if self.wall:
            names["wall"] = ["wall"] if style == "models" else [self.wall_side]
        rules = []
        for one, other in combinations(names, 2):
            for a, b in product(names[one], names[other]):
                if dice.chance(0.9):
                    name = f"{a.rpartition('/')[2]}-{b.rpartition('/')[2]}"
                    rules.append({"between": [a, b], "name": name, **self._surface(dice, usual)})
        if not rules:
            rules = [{"between": ["robot", "o0"], "restitution": 0.5, "name": "robot-o0"}]
        elif dice.chance(0.02) and not self.presses:  # an impact that gains energy ends the run where several contacts meet
            rules[0] |= {"restitution": 1.2, "super_elastic": True, "mu": 0.0}
        if len(grips := self.robot.grips) == 2 and style == "geoms" and dice.chance(0.5):
            rules.append({"between": [f"robot/{grip}" for grip in grips], "restitution": 0.4, "name": "grips"})
            said["ignored"] = []
        self.rule_names = [rule["name"] for rule in rules]
        return said | {"rules": rules}

    def _surface(self, dice: Dice, usual: float) -> dict[str, float]:
        """Restitution and friction."""
        e = usual if dice.chance(0.5) else dice.pick(RESTITUTIONS)
        if self.presses and e == 1.0:
            e = 0.5  # what is pressed and never rests bounces a thousand times in a step
        return {"restitution": e} | ({"mu": dice.between(0.02, 1.0)} if self.rough and dice.chance(0.6) else {})

    def _variations(self, sensing: SensorDrawing) -> dict[str, Any]:
        """Masses and sizes that differ from those of the files, models of control laws that are wrong, and the end."""
        dice, said = Dice(self.seed, "variations"), {}
        if dice.chance(0.15):
            said["controller_model"] = {"robot": {"base": {"mass_kg": dice.between(3.0, 100.0)}}}
        if dice.chance(0.15):
            said["model"] = {name: {name: {"mass_kg": dice.log_between(0.5, 20.0)}} for name in self.objects}
        if "joint_flex" in self.robot.keys and (sensing.estimator or dice.chance(0.5)):  # estimators need the plant's joints
            said["controller_joints"] = "flexible"
        if dice.chance(0.05):
            said["stop_on_impact"] = True
        return said

    def _actuation(self, laws: LawDrawing) -> dict[str, Any]:
        dice, said, configs = Dice(self.seed, "actuation"), {}, {}
        if dice.chance(0.2):
            said["actuation"] = {
                "delay_s": dice.pick([0.0, self.period_s, dice.between(0.1, 3.0) * self.period_s]),
                "control_jitter_s": dice.pick([0.0, dice.between(0.1, 0.9) * self.period_s]),
            }
        for each in self.robot.actuators:
            config: dict[str, Any] = {}
            if each.kind == "joint" and dice.chance(0.15) and not laws.follows_path:
                config = {"kind": "torque_speed", "stall_torque_N_m": 1.5 * each.size}
                config["no_load_speed_rad_s"] = dice.between(0.5, 5.0)
            elif each.kind == "wheel" and dice.chance(0.5):
                config = {"kind": "reaction_wheel", "max_torque_N_m": 0.8 * each.size}
                config["max_speed_rad_s"] = dice.between(0.5, 20.0)
            elif each.kind == "jet" and dice.chance(0.5):
                config = {
                    "kind": "on_off",
                    "force_N": each.size,
                    "threshold_N": 0.3 * each.size,
                    "release_N": 0.1 * each.size,
                }
                config["min_on_time_s"] = dice.pick([0.0, dice.between(0.0, 5.0) * self.period_s])
            elif dice.chance(0.05):
                config = {"kind": "ideal", "delay_s": dice.between(0.0, 2.0) * self.period_s}
            if config:
                configs[each.name] = config
        return said | ({"actuators": configs} if configs else {})

    def _impacts(self, contacts: dict[str, Any]) -> dict[str, Any]:
        dice, said = Dice(self.seed, "impacts"), {}
        law = dice.pick(["blend"] * 30 + ["poisson"] * 15 + ["newton"])
        if law == "newton" and "mu" in str(contacts):
            law = "poisson"
        impact: dict[str, Any] = {"law": law}
        if dice.chance(0.2):
            impact["rest_interval_s"] = self.step_s * dice.between(0.3, 5.0)
        if dice.chance(0.1):
            impact["rest_speed_m_s"] = dice.log_between(1e-4, 1e-2)
        limits = {name: {"restitution": dice.pick([0.0, 0.3, 0.8, 1.0])} for name in self.robot.limited if dice.chance(0.6)}
        said["impact"] = impact
        if self.robot.keys.get("limits") == "ignore":
            limits = {}
        return said | ({"joint_limits": limits} if limits else {})

    def _start(self, stage: Stage) -> tuple[dict[str, Any], dict[str, Any]]:
        """Coordinates, rates and fixed poses: objects in line or flying by, then all turned and boosted."""
        dice = Dice(self.seed, "start")
        frame = Rotation.from_quat(self.turn, scalar_first=True)
        joints: dict[str, Any] = {}
        rates: dict[str, Any] = {}
        for name in self.robot.joints:
            at = 0.1 * dice.rng.normal()
            joints[name] = float(np.clip(at, -0.01, 0.01)) if name in self.robot.limited else at
            rates[name] = dice.pick([0.0, 0.5]) * dice.rng.normal()
            if self.aligned:
                joints[name], rates[name] = 0.0, 0.0
        stage.set_joints({f"robot/{name}": value for name, value in joints.items()})
        stage.place("robot")
        self.tips = {tip: frame.apply(stage.site(f"robot/{tip}")).tolist() for tip in self.robot.tips}
        spin = lambda: dice.pick([0.0, 0.3, 3.0]) * dice.rng.normal(size=3) * (not self.aligned)  # noqa: E731
        motion = (np.zeros(3), 0.1 * dice.rng.normal(size=3), 0.1 * spin(), np.array([1.0, 0.0, 0.0, 0.0]))
        self._set_base("robot", self.base, motion, joints, rates)
        if dice.chance(0.25):
            rates |= {name: [0.0] * np.size(value) if np.size(value) > 1 else 0.0 for name, value in rates.items()}
        poses: dict[str, Any] = {}
        walls = ["wall"] if self.wall else []
        for k, name in enumerate([*self.objects, *walls]):
            self._place(stage, dice, k, name, joints, rates, poses)
        for name in walls:
            place = np.array(poses[name]["position_m"])
            # What is parallel but for 1e-3 rad lands flat within some milliseconds.
            tilt = Rotation.from_rotvec(dice.pick([0.0, 5e-4]) * dice.rng.normal(size=3) * self.aligned)
            quat = (frame * tilt).as_quat(scalar_first=True).tolist()
            poses[name] = {"position_m": frame.apply(place).tolist(), "quaternion": quat}
        return {"joints": joints, "rates": rates}, poses

    def _place(
        self,
        stage: Stage,
        dice: Dice,
        k: int,
        name: str,
        joints: dict[str, Any],
        rates: dict[str, Any],
        poses: dict[str, Any],
    ) -> None:
        """One object; its base is free or in a plane."""
        model = self.objects.get(name)
        flat = self.flat or (model is not None and model.base == "planar")
        quat = np.array(dice.turn(0.7))
        if flat:
            quat = np.array([np.cos(a := dice.between(-3.0, 3.0)), 0.0, 0.0, np.sin(a)])
        if model is None or self.aligned:
            quat = np.array([1.0, 0.0, 0.0, 0.0])
        keep = np.array([1.0, 1.0, 0.0]) if flat else np.ones(3)
        fly_by = model is not None and not self.presses and dice.chance(0.4)
        way = -keep * dice.rng.normal(size=3) if fly_by else np.array([-1.0, 0.0, 0.0])
        way /= np.linalg.norm(way)
        aim = keep * dice.rng.normal(size=3) * (0.2 if fly_by else 0.05) + ([0.3, 0.0, 0.0] if fly_by else [0.0, 0.0, 0.0])
        start = aim - (5.0 + 0.5 * k) * way
        if model is not None:
            full = [f"{name}/{joint}" for joint in model.base_joints]
            in_plane = dict(zip(full, [0.0, 0.0, 2.0 * np.arctan2(quat[3], quat[0])], strict=False))
            stage.set_joints({full[0]: [0.0, 0.0, 0.0, *quat]} if model.base == "free" else in_plane)
        gaps = [1e-4, 3e-3, 1e-2] if self.presses else [1e-4, 3e-3, 1e-2, 3e-2, 0.1, 0.3]
        gap = max(dice.pick([0.0, *gaps]), stage.sharpness(name), 5e-3 * (self.aligned and model is None))
        gone = stage.approach_from(name, start, way, gap)
        centre = start + (gone if gone is not None else 4.5) * way
        stage.move(name, centre)
        if model is None:
            poses[name] = {"position_m": centre.tolist()}
            return
        speed = dice.between(0.1, 1.5) if k == 0 or fly_by else dice.pick([0.0, 0.0, 0.5])
        sideways = (speed > 0.0) and not (self.aligned and dice.chance(0.5))
        velocity = keep * (speed * way + 0.05 * dice.rng.normal(size=3) * sideways)
        turning = dice.pick([0.0, 0.3, 3.0]) * dice.rng.normal(size=3) * (not self.aligned)
        self._set_base(name, model.base, (centre, velocity, turning, quat), joints, rates)
        stage.place(name)

    def _set_base(self, name: str, base: str, motion: Any, joints: dict[str, Any], rates: dict[str, Any]) -> None:
        """Coordinates and rates of the base of a model, in the turned and boosted frame.

        Args:
            name: The model.
            base: Kind of its base.
            motion: Position, velocity, angular velocity in body axes, and quaternion.
            joints: Coordinates, to which those of the base are added.
            rates: Likewise.
        """
        place, velocity, turning, quat = motion
        frame = Rotation.from_quat(self.turn, scalar_first=True)
        if base == "ball":
            joints[f"{name}/ball"], rates[f"{name}/ball"] = quat.tolist(), turning.tolist()
        elif base == "planar":
            coordinates = [place[0], place[1], 2.0 * np.arctan2(quat[3], quat[0])]
            speeds = [velocity[0] + self.boost[0], velocity[1] + self.boost[1], turning[2]]
            for joint, coordinate, speed in zip(("x", "y", "yaw"), coordinates, speeds, strict=True):
                joints[f"{name}/{joint}"], rates[f"{name}/{joint}"] = float(coordinate), float(speed)
        else:
            turned = (frame * Rotation.from_quat(quat, scalar_first=True)).as_quat(scalar_first=True)
            joints[f"{name}/free"] = [*frame.apply(place).tolist(), *turned.tolist()]
            rates[f"{name}/free"] = [*(frame.apply(velocity) + self.boost).tolist(), *np.asarray(turning).tolist()]
