"""The case study and the seven-joint arm with one law on the task's output, ideal motors and nothing to hit."""

from __future__ import annotations

import numpy as np

import ffsm_mj

W = 0.4
PD = {"kp_1_s2": W**2, "kd_1_s": 2.0 * W}
"""Critically damped: from rest the distance falls as (1 + W t) exp(-W t)."""

JOINTS = {"yaw": 0.4, "shoulder": -1.2, "upper_roll": 0.6, "elbow": 1.9, "fore_roll": -0.5, "wrist": 0.8, "hand_roll": 0.3}
LAWS = {
    "gjm_rate": {"position": {"k_1_s": 0.5, "max_speed_m_s": 0.2}, "servo_gain_1_s": 10.0},
    "task_tj": {"position": {"kp_N_m": 2.0, "kd_N_s_m": 8.0}, "joint_damping_N_m_s_rad": 0.1},
    "task_ct": {"position": PD},
    "rns": {"position": PD},
    "lqr": {"Q": [1.0, 1.0, 0.5, 0.5], "R": [1.0, 1.0, 1.0]},
    "impedance": {"position": {"stiffness_N_m": 1.0}},
}
"""Gains for the planar arm by kind."""
SPATIAL = {
    "gjm_rate": {"position": {"k_1_s": 0.5}, "attitude": {"k_1_s": 0.5}, "servo_gain_1_s": 10.0},
    "task_tj": {
        "position": {"kp_N_m": 20.0, "kd_N_s_m": 40.0},
        "attitude": {"kp_N_m_rad": 5.0, "kd_N_m_s_rad": 10.0},
        "joint_damping_N_m_s_rad": 1.0,
    },
    "task_ct": {"position": PD, "attitude": PD, "joint_damping_N_m_s_rad": 2.0},
    "rns": {"position": PD, "joint_damping_N_m_s_rad": 2.0},
    "lqr": {"Q": [1.0] * 6 + [2.0] * 6, "R": [0.01] * 7, "attitude": {}, "refresh": True},
    "impedance": {"position": {"stiffness_N_m": 20.0}, "attitude": {"stiffness_N_m_rad": 5.0}},
}
"""Gains for the arm in space by kind."""


def planar_run(law, period_s, duration_s, **changes):
    """The arm of the case study from its start to the target of its task."""
    return ffsm_mj.run("baseline", planar(law, period_s, duration_s, **changes))


def planar(law, period_s, duration_s, **changes):
    """Overrides of ``baseline``."""
    return common(law, period_s, duration_s) | {"initial.joints.object/x": -50.0} | changes


def spatial_run(law, period_s, duration_s, offset_m=(0.1, -0.15, 0.12), **changes):
    """The seven-joint arm from rest to a point at an offset from its tip."""
    return ffsm_mj.run("spatial", spatial(law, period_s, duration_s, offset_m, **changes))


def spatial(law, period_s, duration_s, offset_m=(0.1, -0.15, 0.12), **changes):
    """Overrides of ``spatial``."""
    start = {"initial.joints": JOINTS | {"satellite/free": [50.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]}, "initial.rates": {}}
    target = (TIP_M + np.array(offset_m)).tolist()
    return common(law, period_s, duration_s) | start | {"task.target_m": target} | changes


TIP_M = np.array([1.30617557, 0.7745763, 0.53720569])
"""Where the tip is at the start."""


def common(law, period_s, duration_s):
    """What both have of it."""
    return {
        "actuators": {},
        "contacts.rules": [],
        "time_step_s": period_s,
        "control_period_s": period_s,
        "duration_s": duration_s,
        "phases": [{"name": "all", "until": "end", "controller": law}],
    }


def reports(run):
    """What the law of the first phase says of its work."""
    return run.summary()["controller"]["phases"][0]["reports"]


def tip(run):
    """Position of the tip, (rows, 3)."""
    return np.stack([run[f"state.tip_{axis}_m"] for axis in "xyz"], axis=1)


def critically_damped(run, w=W):
    """Distance from the target as the gains have it."""
    t = run.time
    return run.tip_error()[0] * (1.0 + w * t) * np.exp(-w * t)
