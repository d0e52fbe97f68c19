"""Metrics of a control law between the start of the phase ``regulate`` and the end of the run.

``cost`` weighs the squared error of the tip against the squared torques of the joints; every other metric is a part of the
picture that it leaves out. Torques are those applied, after the bounds of the motors.
"""

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray

EFFORT_WEIGHT = 0.01
"""Weight of the squared torques in ``cost``, m^2/(N m)^2."""
HELD_M = 0.1
"""Error below which the tip counts as held, m."""


def cost(run: Run) -> float:
    """Integral of |e|^2 + 0.01 |u|^2, m^2 s."""
    return error_integral(run) + EFFORT_WEIGHT * effort_integral(run)


def error_integral(run: Run) -> float:
    """Integral of the squared error of the tip, m^2 s, by the trapezoidal rule."""
    first = _first(run)
    return float(np.trapezoid(run.tip_error()[first:] ** 2, run.time[first:]))


def effort_integral(run: Run) -> float:
    """Integral of the squared torques of the joints, (N m)^2 s; they are held from row to row."""
    torques, times = _torques(run), run.time[_first(run) :]
    return float((torques[:-1] ** 2).sum(axis=1) @ np.diff(times))


def peak_torque(run: Run) -> float:
    """Greatest magnitude of a torque, N m."""
    return float(np.abs(_torques(run)).max())


def least_error(run: Run) -> float:
    """Least error of the tip, m."""
    return float(run.tip_error()[_first(run) :].min())


def final_error(run: Run) -> float:
    """Error of the tip at the end, m."""
    return float(run.tip_error()[-1])


def held(run: Run) -> float:
    """Time with an error below 0.1 m, s."""
    first = _first(run)
    return float(np.diff(run.time[first:]) @ (run.tip_error()[first:-1] < HELD_M))


def first_held(run: Run) -> float | None:
    """Time from the start of the phase until the error is first below 0.1 m, s; none if it never is."""
    first = _first(run)
    below = np.flatnonzero(run.tip_error()[first:] < HELD_M)
    return float(run.time[first + below[0]] - run.time[first]) if len(below) else None


def base_turn(run: Run) -> float | None:
    """Greatest angle of the base from its orientation at the start of the phase, rad; of a planar robot."""
    name = next((name for name in run.keys if name.endswith("base_yaw_rad")), None)
    if name is None:
        return None
    angle = run[name][_first(run) :]
    return float(np.abs(angle - angle[0]).max())


def impulse(run: Run) -> float | None:
    """Impulse of the first impact, N s; none without an impact. It depends on what was before the law only."""
    return run.impacts[0].impulse_N_s if run.impacts else None


def overlaps(run: Run) -> int:
    """Number of overlaps of unhandled pairs that last into the phase."""
    return sum(each.end_s > _start_s(run) for each in run.unhandled_contacts)


def _start_s(run: Run) -> float:
    return next(phase.start_s for phase in run.phases if phase.name == "regulate")


def _first(run: Run) -> int:
    """First row of the phase."""
    return int(np.searchsorted(run.time, _start_s(run) - 1e-9))


def _torques(run: Run) -> FloatArray:
    """Torques of the joints in the phase, N m, (n, joints): of actuators that drive neither base nor wheels."""
    return np.column_stack([run[name][_first(run) :] for name in _arm(run)])


def _arm(run: Run) -> list[str]:
    names = [name for name in run.keys if name.startswith("actuators.") and name.endswith("_applied_N_m")]
    return [name for name in names if "wheel" not in name]
