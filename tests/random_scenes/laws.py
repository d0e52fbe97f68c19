"""Control laws and phases of random scenes."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import ffsm_mj
from tests.random_scenes.dice import Dice
from tests.random_scenes.models import Model


class LawDrawing:
    """Draws the laws of a scene, and writes the records that some of them play.

    Args:
        seed: The seed.
        robot: The robot.
        objects: Its objects, without fixed ones.
        times: Time step, control period and duration, s.
        presses: Whether the efforts of joints are biased towards the objects.
        flat: Whether everything moves in the plane z = 0.
        folder: Where to write records of efforts.
    """

    def __init__(
        self,
        seed: int,
        robot: Model,
        objects: dict[str, Model],
        times: tuple[float, float, float],
        *,
        presses: bool,
        flat: bool,
        folder: Path,
    ) -> None:
        self.dice, self.robot, self.objects = Dice(seed, "laws"), robot, objects
        self.presses, self.flat, self.folder = presses, flat, folder
        self.step_s, self.period_s, self.duration_s = times
        self.tips: dict[str, list[float]] = {}
        """Positions of the tips at the start, world axes."""
        self._tip = ""
        self.task: dict[str, Any] | None = None
        self.follows_path = False  # a path that exceeds the limits of a motor is refused
        self._count = 0

    def law(self) -> dict[str, Any]:
        """Keys of a phase: ``controller``, or ``controllers`` of several parts."""
        dice = self.dice
        joints = [each.name[2:] for each in self.robot.actuators if each.kind == "joint"]
        wheels = [each.name for each in self.robot.actuators if each.kind == "wheel"]
        if not self.robot.actuators or dice.chance(0.05):
            return {"controller": {"kind": "off"}}
        if not joints or dice.chance(0.6 if not self.presses else 0.75):
            return {"controller": self.playback([each.name for each in self.robot.actuators])}
        kind = dice.pick(["pd", "hold", "joint_path", "track", "parts", "tip", "base"])
        if kind == "parts" and len(joints) > 1:
            split = dice.integer(1, len(joints) - 1)
            parts = {"one": self.feedback(joints[:split]), "other": self.feedback(joints[split:])}
            others = [each.name for each in self.robot.actuators if each.kind != "joint"]
            return {"controllers": parts | ({"rest": self.playback(others)} if others else {})}
        law = self.feedback(joints, kind)
        if kind == "tip" and len(moving := self._moving(joints)) > 1:
            law = self.on_tip(moving)
        elif kind == "base" and wheels and self.robot.base == "free":
            law = self.on_base(joints, wheels)
        elif kind == "track" and self.robot.base != "ball":
            law = self.track(joints, wheels)
        return {"controller": law}

    def feedback(self, joints: list[str], kind: str = "") -> dict[str, Any]:
        """A law on joints."""
        dice = self.dice
        known = ["pd", "hold", "joint_path"]
        law: dict[str, Any] = {"kind": kind if kind in known else dice.pick(known), "joints": joints}
        if law["kind"] == "joint_path" and self.robot.limited:
            law["kind"] = "hold"  # a path that begins anew at a grasp or event may pass a limit, which ends the run
        bandwidth = dice.log_between(0.5, min(60.0, 0.2 / self.period_s))
        if law["kind"] == "pd":
            law |= {"kp": dice.log_between(0.1, 20.0), "kd": dice.log_between(0.02, 0.2)}
            if dice.chance(0.5):
                law["target"] = [0.05 * x for x in dice.rng.normal(size=len(joints))]
        elif law["kind"] == "hold":
            law |= {"bandwidth_rad_s": bandwidth, "damping_ratio": dice.between(0.4, 1.2)}
        else:
            # Positions of joints with limits are inside every range that is drawn.
            self.follows_path = True
            positions = dice.rng.uniform(-0.01, 0.01, len(joints)).tolist()
            law["bandwidth_rad_s"] = bandwidth
            law["waypoints"] = [{"at_s": dice.between(0.3, 1.5) * self.duration_s, "positions": positions}]
        return law

    def _moving(self, joints: list[str]) -> list[str]:
        """Joints that move the tip of the task: those of its arm."""
        if self.task is None:
            self._tip = self.dice.pick([*self.tips])
        return [name for name in joints if name in self.robot.arms[[*self.tips].index(self._tip)]]

    def on_tip(self, joints: list[str]) -> dict[str, Any]:
        """A law on the tip of the task."""
        dice = self.dice
        if self.task is None:
            axes = ["x", "y", "z"] if len(joints) > 2 and not self.flat else ["x", "y"]
            tip = self._tip
            target = [self.tips[tip]["xyz".index(axis)] + 0.1 * dice.rng.normal() for axis in axes]
            self.task = {"tip": tip, "axes": axes, "target_m": target}
            if dice.chance(0.3):
                where = [x + 0.1 * dice.rng.normal() for x in target]
                self.task["trajectory"] = {"waypoints": [{"at_s": 0.7 * self.duration_s, "position_m": where}]}
        rate = dice.log_between(0.5, min(10.0, 0.05 / self.period_s))
        accelerations = {"kp_1_s2": rate**2, "kd_1_s": 2.0 * rate}
        axes_of_base = 1 if self.flat else 3
        law = dice.pick(
            [
                {"kind": "task_ct", "position": accelerations},
                # The reaction null space needs more joints than the base has axes to turn about.
                {"kind": "rns", "position": accelerations, "base": {"kd_1_s": 0.5}}
                if len(joints) > axes_of_base
                else {"kind": "task_ct", "position": accelerations},
                {"kind": "task_tj", "position": {"kp_N_m": 1.0, "kd_N_s_m": 0.5}, "joint_damping_N_m_s_rad": 0.02},
                {"kind": "gjm_rate", "position": {"k_1_s": rate, "max_speed_m_s": 0.2}, "servo_gain_1_s": 5.0 * rate},
                {"kind": "impedance", "position": {"stiffness_N_m": 4.0, "max_force_N": 2.0}, "damping_ratio": 0.7},
            ]
        )
        return law | {"joints": joints}

    def on_base(self, joints: list[str], wheels: list[str]) -> dict[str, Any]:
        """A law on the base by its wheel, with the arm or without."""
        law: dict[str, Any] = {"kind": self.dice.pick(["base_pd", "free_flying"]), "wheels": wheels}
        law["rotation"] = {"kp": 0.1, "kd": 0.2}
        if law["kind"] == "free_flying":
            law["arm"] = {"joints": joints, "kp": 1.0, "kd": 0.1}
        return law

    def track(self, joints: list[str], wheels: list[str]) -> dict[str, Any]:
        """A site of the robot follows one of an object."""
        dice = self.dice
        rate = dice.log_between(0.5, min(20.0, 0.1 / self.period_s))
        law: dict[str, Any] = {
            "kind": "track",
            "robot_site": self.robot.tips[0],
            "object_site": f"{dice.pick([*self.objects])}/handle",
            "offset_m": dice.vector(0.05),
            "position": {"kp_1_s2": rate**2, "kd_1_s": 2.0 * rate, "max_speed_m_s": dice.between(0.05, 1.0)},
            "joint_damping_N_m_s_rad": dice.between(0.0, 0.1),
            "max_torque_N_m": dice.log_between(0.1, 10.0),
        }
        if dice.chance(0.3):
            law["attitude"] = {"kp_1_s2": rate**2, "kd_1_s": 2.0 * rate}
        if wheels and dice.chance(0.5):
            law["base"] = {"wheels": wheels, "rotation": {"kp_N_m_rad": 0.1, "kd_N_m_s_rad": 0.1}}
        return law

    def playback(self, names: list[str]) -> dict[str, Any]:
        """Bias and wave of each actuator from a CSV file; jets, torquers and wheels switch with the sign of the wave."""
        dice, path = self.dice, self.folder / f"efforts{self._count}.csv"
        self._count += 1
        played = [each for each in self.robot.actuators if each.name in names]
        interval = self.period_s * dice.pick([1, 1, 1, 2])
        times = np.arange(0.0, self.duration_s + interval, interval)
        bias = dice.between(0.5, 2.0) if self.presses else dice.pick([0.0, 0.5])
        columns: list[np.ndarray] = []
        for each in played:
            wave = np.sin(dice.between(2.0, 30.0) * times + dice.between(0.0, 2.0 * math.pi))
            columns.append(each.size * (bias + wave if each.kind == "joint" else np.sign(wave)))
        head = ",".join(["time_s", *(f"{each.name}_{each.unit}" for each in played)])
        np.savetxt(path, np.column_stack([times, *columns]), delimiter=",", header=head, comments="", fmt="%.17g")
        if names == [each.name for each in self.robot.actuators] and dice.chance(0.1):
            path = self._recorded(path)
        law: dict[str, Any] = {"kind": "playback", "file": path.name, "after": dice.pick(["off", "hold"])}
        if dice.chance(0.3):
            law["interpolation"] = dice.pick(["mean", "linear"])
        return law

    def _recorded(self, path: Path) -> Path:
        """A log in which the robot, alone, plays the efforts of a table."""
        folder = self.folder / f"recording{self._count}"
        folder.mkdir()
        for name in ("robot.xml", path.name):
            (folder / name).write_text((self.folder / name).read_text())
        scene = {
            "name": "recording",
            "duration_s": self.duration_s,
            "time_step_s": self.period_s,
            "control_period_s": self.period_s,
            "conservative": False,
            "robot": {"mjcf": "robot.xml", "strip": ["damping", "stiffness", "gravcomp"], "limits": "ignore"},
            "contacts": {"rules": []},
            "phases": [{"name": "play", "until": "end", "controller": {"kind": "playback", "file": path.name}}],
        }
        (folder / "scene.yaml").write_text(json.dumps(scene))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ffsm_mj.run(folder / "scene.yaml", out=folder / "run", overrides={"log.rerun": False})
        return (folder / "run" / "run.mcap").rename(path.with_suffix(".mcap"))


class PhaseDrawing:
    """Draws grasps and phases."""

    def __init__(self, seed: int, laws: LawDrawing, rules: list[str], ends: list[dict[str, Any]], most: int) -> None:
        self.most = most
        self.dice, self.laws, self.rules, self.ends = Dice(seed, "phases"), laws, rules, ends
        self.grasps: dict[str, Any] = {}
        # Objects in a plane can be taken along by a robot in that plane only.
        self.graspable = [name for name, made in laws.objects.items() if laws.flat or made.base == "free"]

    def scenario(self) -> dict[str, Any]:
        """Keys ``grasps``, ``phases`` and ``task``."""
        said = self._phases()
        return said | ({"grasps": self.grasps} if self.grasps else {}) | ({"task": self.laws.task} if self.laws.task else {})

    def _phases(self) -> dict[str, Any]:
        dice = self.dice
        if self.graspable and dice.chance(0.6):
            for i in range(min(self.most, dice.pick([1, 1, 2]))):
                self.grasps[f"c{i}"] = self._grasp(i)
        ticks = round(self.laws.duration_s / self.laws.period_s)
        share = lambda low, high: max(1, round(dice.between(low, high) * ticks)) * self.laws.period_s  # noqa: E731
        if not self.grasps and dice.chance(0.7):
            return {"phases": [{"name": "move", "until": "end", **self.laws.law()}]}
        armed = [*self.grasps]
        first: dict[str, Any] = {"name": "meet", "for_s": share(0.3, 0.9), "arm": armed, **self.laws.law()}
        until: Any = dice.pick(["grasp" if armed else "impact", "impact", "contact_begins", "contact_ends", "", ""])
        if not until and self.ends and dice.chance(0.5):
            until = self.ends[0]
        first |= {"until": until} if until else {}
        if dice.chance(0.15):
            driven = any(each.kind == "joint" for each in self.laws.robot.actuators)
            quantity = dice.pick(["joint_rate", "base_rate"]) if driven else "base_rate"
            first["stop_when"] = f"{quantity} > {dice.log_between(0.05, 2.0):.3f} rad/s"
        more = dice.some(armed, 1)
        second = {"name": "stay", "for_s": share(0.1, 0.5), "arm": more if until != "grasp" else [], **self.laws.law()}
        last = {"name": "leave", "until": "end", "release": armed if dice.chance(0.7) else [], **self.laws.law()}
        if dice.chance(0.2):
            last["arm"] = [name for name in armed if last["release"]]
        if dice.chance(0.15):
            first["on"] = {name: "leave" for name in ("impact", *(["grasp"] if armed else [])) if name != first.get("until")}
            first["on"]["time"] = "stay"
            return {"phases": [first, second, last]}
        return {"phases": [first, second, last] if dice.chance(0.7) else [first, last]}

    def _grasp(self, i: int) -> dict[str, Any]:
        dice, robot = self.dice, self.laws.robot
        name = dice.pick(self.graspable) if i else self.graspable[0]
        ends = (f"-{name}", *(f"-{geom}" for geom in self.laws.objects[name].geoms))
        touches = [rule for rule in self.rules if rule.endswith(ends) and not rule.startswith("o")]
        within = {"position_m": dice.between(0.05, 0.6)}
        if dice.chance(0.4):
            within["speed_m_s"] = dice.between(0.2, 3.0)
        if dice.chance(0.2):
            within["rate_rad_s"] = dice.between(0.2, 3.0)
        if dice.chance(0.2):
            within["angle_rad"] = dice.between(0.5, 3.0)
        when = {"touch": touches} if touches and dice.chance(0.4) else {"within": within}
        flat = self.laws.flat
        joint = dice.pick(
            ["rigid", "hinge", "slide"] if flat else ["rigid", "rigid", "ball", "hinge", "slide", "cylindrical"]
        )
        grasp = {
            "robot_site": robot.tips[min(i, len(robot.tips) - 1)] if dice.chance(0.8) else dice.pick(robot.tips),
            "object_site": f"{name}/{dice.pick(['handle', 'knob']) if i else 'handle'}",
            "when": when,
            "joint": joint,
        }
        if joint not in ("rigid", "ball"):
            grasp["axis"] = dice.direction()
            if flat:
                grasp["axis"] = [0.0, 0.0, 1.0] if joint == "hinge" else [*grasp["axis"][:2], 0.0]
        if dice.chance(0.15):
            grasp["load_limit"] = {"force_N": dice.log_between(0.5, 50.0)}
        return grasp
