"""What the tests read off a run."""

from __future__ import annotations

import math

import numpy as np


def heat(run):
    """Heat of friction until the end, J."""
    return float(run["balance.friction_heat_J"][-1])


def final(run, column):
    """Last values of all columns that begin so: ``q_robot_free`` is x, y, z and a quaternion, ``v_...`` six rates."""
    keys = [key for key in run.keys if key.startswith(f"state.{column}")]
    assert keys, f"no column begins with state.{column}"
    return np.array([run[key][-1] for key in keys])


def at(run, time_s, column):
    """The same at a row."""
    row = int(np.argmin(np.abs(run.time - time_s)))
    assert abs(run.time[row] - time_s) < 1e-9
    return np.array([run[key][row] for key in run.keys if key.startswith(f"state.{column}")])


def yaw(run, column):
    """Turn about z at the end, rad, of a body that turns about z, but for little."""
    w, _, _, z = final(run, column)[3:]
    return 2.0 * math.atan2(z, w)


def slips(run):
    """Times at which pairs begin to slip, s."""
    return [record.time_s for record in run.records["contact_slips"]]


def sticks(run):
    """Times at which pairs begin to stick, s."""
    return [record.time_s for record in run.records["contact_sticks"]]
