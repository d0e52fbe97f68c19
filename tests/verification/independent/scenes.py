"""Runs of a second or so with everything that the independent checks look at."""

from __future__ import annotations

from dataclasses import replace

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.verification.independent.finding import TOLERANCES
from tests.contact_models.grasp.scenes import grasping
from tests.scenes import CHAIN, ball, box, scene, three_balls
from tests.sensing.scenes import pushing
from tests.sensing.scenes import run as run_listening

WEIGHT = '<option gravity="0 0 -9.81"/>'
FLOOR = '<mujoco><option gravity="0 0 -9.81"/><worldbody><geom name="floor" type="box" size="4 4 0.5"/></worldbody></mujoco>'


def heavy(model: str) -> str:
    """A model with weight."""
    return model.replace('<option gravity="0 0 0"/>', WEIGHT)


def bouncing(folder, *, weight=heavy, **changes):
    """A ball falls 0.2 m, bounces with e = 0.5 and comes to rest: its bounces last 0.2 s and less, those below 2 ms none."""
    return ffsm_mj.run(
        scene(
            folder,
            weight(ball(joints="z")),
            {"floor": weight(FLOOR.replace(WEIGHT, '<option gravity="0 0 0"/>'))},
            fixed={"floor": {"position_m": [0, 0, -0.5]}},
            conservative=False,
            initial={"joints": {"z": 0.3}},
            contacts={"rules": [{"between": ["ball", "floor"], "restitution": 0.5}]},
            impact={"rest_interval_s": 0.002},
            **changes,
        )
    )


def pulled(folder):
    """The same without gravity, in a uniform field."""
    environment = {"fields": [{"kind": "uniform", "acceleration_m_s2": [0, 0, -9.81]}]}
    return bouncing(folder, weight=str, environment=environment)


def chain(folder):
    """A ball hits a row of two, with another e for each pair."""
    return ffsm_mj.run(three_balls(folder, CHAIN))


def sliding(folder):
    """A box falls onto a floor, slides and stops."""
    return ffsm_mj.run(
        scene(
            folder,
            heavy(ball(joints="z")),
            {"box": heavy(box("box", half=(0.2, 0.2, 0.1))), "floor": FLOOR},
            fixed={"floor": {"position_m": [0, 0, -0.5]}},
            conservative=False,
            initial={
                "joints": {"robot/z": 9.0, "box/free": [0, 0, 0.12, 1, 0, 0, 0]},
                "rates": {"box/free": [1.0, 0.2, 0, 0, 0, 0]},
            },
            contacts={"rules": [{"between": ["box", "floor"], "restitution": 0.0, "mu": 0.3}]},
            control_period_s=0.01,
            duration_s=0.5,
        )
    )


def holding(folder, **changes):
    """An arm catches a tumbling ball, holds and moves it, and lets it go."""
    return ffsm_mj.run(grasping(folder, control_period_s=0.01, **changes))


SENSORS = {
    "gyro": {"noise": 1e-3, "bias_walk": 0.1, "misalignment_rad": [0.1, 0.2, 0.3], "scale_error": 0.01},
    "encoder": {"quantum": 1e-3, "dropout": 0.3, "delay_jitter_s": 0.02},
    "attitude": {"noise": 0.01, "bias_walk": 0.02, "interval_s": 0.02, "delay_s": 0.03},
    **{name: {"interval_s": 0.01} for name in ("acc", "force", "torque", "pad")},
}


def measuring(folder, **changes):
    """An arm with eight sensors, all but two sampled at the ticks, pushes against a box."""
    return run_listening(pushing(folder, **{"sensors": SENSORS, "seed": 5} | changes))


def independent(run):
    """The independent checks of a run by name, as its log alone has them."""
    checks = all_checks(ffsm_mj.Run(run.log))
    return {check.name: check for check in checks if check.name in TOLERANCES}


def failing(run):
    """Names of the independent checks that fail."""
    return {name for name, check in independent(run).items() if not check.passes}


def changed(run, key, change):
    """The run with a column of its log changed by a function."""
    rows = run.log.rows.copy()
    column = run.log.header.layout.index[key]
    rows[:, column] = change(rows[:, column])
    return ffsm_mj.Run(replace(run.log, rows=rows))
