"""The cells of the comparison: a scenario, the phase that the laws control, dispersions and how many runs."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from laws import LAWS, MAIN, Config, Law

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.experiments.design import Design
from ffsm_mj.experiments.file import campaigns_dir
from ffsm_mj.experiments.planning import load_plan
from ffsm_mj.scenario.shipped import scenarios_dir

CAMPAIGNS = campaigns_dir()
REACH_END_S = 22.578
"""Time at which the target of the baseline leaves the reach of the robot that drifts after the impact, s."""
_ARM = ("yaw", "shoulder", "upper_roll", "elbow", "fore_roll", "wrist", "hand_roll")


@dataclass(frozen=True)
class Cell:
    """A scenario with one phase ``regulate`` for each of the laws.

    Attributes:
        name: Name of the cell; that of its campaign is ``control-laws-`` and this.
        title: Name for tables.
        scenario: Shipped scenario.
        overrides: What all runs change in it.
        outputs: Coordinates of the tip that are controlled.
        joints: Joints that the laws drive.
        dispersions: Dispersed keys.
        runs: Judged runs of each variant.
        laws: The laws that are judged.
        tuned_in: Cell whose points give the tuned parameters.
        has_floor: Whether the planar robot drifts in the phase, so that the target leaves its reach.
    """

    name: str
    title: str
    scenario: str
    overrides: Config
    outputs: int
    joints: tuple[str, ...]
    dispersions: Config
    runs: int
    laws: tuple[Law, ...]
    tuned_in: str
    has_floor: bool = False

    def controller(self, law: Law, values: tuple[float, float]) -> Config:
        """Controller of the phase for values of the tuned parameters."""
        return law.config(*values, self.outputs, len(self.joints)) | {"joints": list(self.joints)}

    def design(self, runs: int, seed: int) -> Design:
        """Samples of the dispersed keys; runs of one seed and index are the same for every law."""
        given = {
            "campaign": f"control-laws-{self.name}",
            "scenario": str(scenarios_dir() / f"{self.scenario}.yaml"),
            "overrides": self.overrides,
            "samples": {"kind": "random", "n": runs, "seed": seed},
            "dispersions": self.dispersions,
        }
        with TemporaryDirectory() as folder:
            file = Path(folder) / "campaign.yaml"
            file.write_text(json.dumps(given))
            return load_plan(file).design()

    def run(self, controller: Config, dispersed: Config, seed: int) -> Run:
        """Simulate one run.

        Args:
            controller: Controller of the phase.
            dispersed: Overrides of a run of the design.
            seed: Seed of the noise of sensors.
        """
        given = {**self.overrides, **dispersed, "seed": seed, "phases.regulate.controller": controller}
        return ffsm_mj.run(self.scenario, given)


def _uniform(key: str, half: float) -> Config:
    return {key: {"offset": {"uniform": [-half, half]}}}


_PLANAR = ("joint_1", "joint_2", "joint_3")
_PLANAR_START = {
    **_uniform("initial.joints.base_x", 0.05),
    **_uniform("initial.joints.base_y", 0.05),
    **_uniform("initial.joints.base_yaw", 0.03),
}
_FOLLOW = {
    "duration_s": 14.0,
    "grasps": {},
    "task": {
        "tip": "tip",
        "target_m": [1.9, 0.0, 0.4],
        "trajectory": {"site": "satellite/grapple", "offset_m": [-0.15, 0.0, 0.0]},
    },
    "phases": [{"name": "regulate", "until": "end", "controller": {"kind": "off"}}],
}
_SATELLITE_START = {
    "initial.joints.satellite/free.position": {
        "offset": {"vector": {"direction": "random", "magnitude": {"uniform": [0.0, 0.15]}}}
    },
    "initial.joints.satellite/free": {"rotation": {"axis": "random", "angle": {"uniform": [0.0, 0.3]}}},
    "initial.rates.satellite/free.linear": {
        "offset": {"vector": {"direction": "random", "magnitude": {"uniform": [0.0, 0.006]}}}
    },
    "initial.rates.satellite/free.angular": {
        "offset": {"vector": {"direction": "random", "magnitude": {"uniform": [0.0, 0.02]}}}
    },
}
_MAIN_LAWS = tuple(law for law in LAWS if law.name in MAIN)

CELLS = {
    cell.name: cell
    for cell in (
        Cell(
            "baseline",
            "same collision, `baseline`",
            "baseline",
            {"duration_s": REACH_END_S},
            2,
            _PLANAR,
            _PLANAR_START | _uniform("initial.joints.object/y", 0.15),
            64,
            LAWS,
            "baseline",
            has_floor=True,
        ),
        Cell(
            "slow-impact",
            "same collision, `slow-impact`",
            "slow-impact",
            {},
            2,
            _PLANAR,
            _PLANAR_START | _uniform("initial.joints.object/y", 0.05),
            20,
            _MAIN_LAWS,
            "baseline",
        ),
        Cell(
            "follow",
            "approach of `capture`, true state",
            "capture",
            _FOLLOW,
            3,
            _ARM,
            _SATELLITE_START,
            20,
            LAWS,
            "follow",
        ),
        Cell(
            "follow-camera",
            "approach of `capture-camera`, its sensors",
            "capture-camera",
            _FOLLOW,
            3,
            _ARM,
            _SATELLITE_START,
            20,
            _MAIN_LAWS,
            "follow",
        ),
    )
}
