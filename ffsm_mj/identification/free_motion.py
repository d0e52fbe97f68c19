"""Free motions between impacts, fitted to recorded poses, and the velocities just before and after each impact.

Poses alone say where a body is, and differences of them what its velocity was some samples ago: at an impact both smear. A
flight is a motion that is known but for its state, of the models of the scenario without contacts and actuators: free fall
or straight lines, and a rotation of constant angular momentum. Its state at the impact follows from all its samples by least
squares. An impact is where velocities jump; its instant is where the flights before and after meet.
"""

from __future__ import annotations

import copy
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.identification.recording import Recording, Recordings

LEAST_SAMPLES = 6
"""Samples that a flight has at least: two of each coordinate give its state, the others say whether it is a flight."""
_WINDOW = 3
"""Intervals of samples on each side over which a jump of velocity is looked for: fewer than a flight has."""
_JUMP = 8.0
"""A jump is an impact from this many standard deviations of its noise on: of 1e5 samples of noise none reaches it."""
_SKIPPED = 1
"""Samples on each side of an impact that no flight uses: the contact lasts, and its instant is known to a sample."""
_NOT_FREE = 3.0
"""Residual of a flight, as a multiple of the noise of the samples, from which on it is none: sliding, rolling, a string."""
_APART = 3.0
"""Distance at which flights pass each other at an impact, as a multiple of the noise, from which on they do not meet: twice
that of flights with the least samples. Two impacts within a few samples part them."""
_TURN_PER_STEP = 0.2
"""Largest rotation in a step of RK4, rad: its error is about that to the power of 5 over 120, 3e-6."""
_MOST_PARTS = 32.0
"""Most steps from one sample to the next: two samples of a turn cannot tell more than half of one."""
_DIFFERENCE = 1e-6
"""Step of numerical derivatives in coordinates and velocities, SI: the square root of rounding, times some."""
_STEPS = 20
"""Steps of the least squares of a flight: a flight takes four; what takes more is none, and is refused by its residual."""
_SLOPES = 2
"""Derivatives that are computed in these: a flight is nearly linear in its state, and near the end they hardly change."""
_FLOOR = 1e-7
"""Least noise of a coordinate or velocity, SI: recordings of simulations have none but the errors of RK4."""
_QUANTILE, _OF_NORMAL = 0.25, 0.3186
"""Quantile that says what is usual, and that of the size of a normal variable of standard deviation 1: of tosses up to three
quarters of the samples are in contact."""
_MEDIAN = 0.6745
"""The same of the median, for velocities: what a mirrored frame does to them in flight must not look like impacts."""
_MOST_MISFIT = 4.0
"""Most that the residuals of good flights may be of the noise of differences: 3 of motion capture that is smoothed. What
slides or rolls has 13 and more there."""


@dataclass(frozen=True)
class FreeMotion:
    """A state of the system from which it flies, onward and back.

    Attributes:
        time_s: Instant of the state.
        qpos: Coordinates, (nq,).
        qvel: Velocities, (nv,).
    """

    time_s: float
    qpos: FloatArray
    qvel: FloatArray


@dataclass(frozen=True)
class _Fit:
    """A fitted flight.

    Attributes:
        motion: Its state at the first sample.
        misfit: Root mean square of its residuals, in units of the noise.
        fall: What the residuals say of gravity, as a share of that of the model, times its weight; 0 without gravity.
        weight: Inverse variance of that share, for residuals of the size of the noise.
    """

    motion: FreeMotion
    misfit: float
    fall: float
    weight: float


@dataclass(frozen=True)
class Jump:
    """An impact in a recording: the states just before and after.

    Attributes:
        place: File and run, for messages.
        time_s: Its instant.
        qpos: Coordinates, midway between both flights, (nq,).
        before: Velocities before, (nv,).
        after: Velocities after, (nv,).
        apart: Root mean square of the distance between the flights there, in units of the noise of the coordinates.
    """

    place: str
    time_s: float
    qpos: FloatArray
    before: FloatArray
    after: FloatArray
    apart: float


@dataclass(frozen=True)
class Jumps:
    """What recordings say of impacts.

    Attributes:
        impacts: The impacts.
        left_out: Why others are not used, with their number.
        noise: Standard deviation of the coordinates, as found in the recordings, (nv,), m and rad; empty for velocities.
        fall: Acceleration of free fall in the flights over that of the model; None without gravity, and for velocities.
    """

    impacts: tuple[Jump, ...]
    left_out: Counter[str]
    noise: FloatArray
    fall: float | None = None


class JumpSearch:
    """Finds the impacts in recordings of a system."""

    def __init__(self, model: Any, recordings: Recordings) -> None:
        """Take a copy of the model, without actuators; contacts are off in the models of a scenario."""
        self._model = copy.copy(model)
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        self._model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        self._data, self._recordings = mujoco.MjData(self._model), recordings
        self._left_out = Counter[str]()

    def jumps(self) -> Jumps:
        """The impacts of all runs."""
        self._left_out = Counter()
        runs = self._recordings.runs
        if all(run.qvel is not None for run in runs):
            return Jumps(tuple(self._between_rows()), self._left_out, np.zeros(0))
        noise = self._noise()
        fitted = [self._fits(run, noise) for run in runs]
        misfits = [one.misfit for _, fits in fitted for one in fits if one is not None]
        # Calibration and smoothing leave more than differences of samples show: what good flights leave is the noise.
        level = min(max(1.0, float(np.quantile(misfits, _QUANTILE))), _MOST_MISFIT) if misfits else 1.0
        scale = level * noise[self._recordings.dofs]
        every = zip(runs, fitted, strict=True)
        impacts = tuple(jump for run, (ends, fits) in every for jump in self._between(run, ends, fits, level, scale))
        falls = [one for _, fits in fitted for one in fits if one is not None and one.misfit <= 2.0 * _NOT_FREE * level]
        weight = sum(one.weight for one in falls)
        fall = 1.0 + sum(one.fall for one in falls) / weight if weight > 0.0 else None
        return Jumps(impacts, self._left_out, level * noise, fall)

    def _leave_out(self, reason: str) -> None:
        self._left_out[reason] += 1

    # ---- Velocities

    def _between_rows(self) -> Iterator[Jump]:
        """Impacts between two rows with velocities."""
        dofs = self._recordings.dofs
        runs = [
            [FreeMotion(*state) for state in zip(run.times.tolist(), run.qpos, np.asarray(run.qvel), strict=True)]
            for run in self._recordings.runs
        ]
        changes = [np.array([self._change(*pair)[dofs] for pair in pairwise(states)]) for states in runs]
        # Two rows of a run are before and after; of several, most have no impact between them.
        quiet = [np.abs(change) for change in changes if len(change) > 1]
        scale = np.median(np.concatenate(quiet), axis=0) / _MEDIAN if quiet else np.zeros(len(dofs))
        for run, states, change in zip(self._recordings.runs, runs, changes, strict=True):
            strength = np.abs(change / np.maximum(scale, _FLOOR)).max(axis=-1) if len(change) else np.zeros(0)
            for k in np.flatnonzero(strength > _JUMP).tolist():
                around = strength[max(k - 1, 0) : k + 2]
                if np.count_nonzero(around > _JUMP) > 1:
                    if strength[k] == around.max():
                        self._leave_out(
                            "the velocity changes over several rows: a contact that lasts, or smoothed velocities"
                        )
                    continue
                yield self._meeting(run.place, states[k], states[k + 1], (states[k].time_s, states[k + 1].time_s), scale)

    def _change(self, before: FreeMotion, after: FreeMotion) -> FloatArray:
        """Change of velocity from one row to the next beyond that of a flight, (nv,)."""
        return np.asarray(after.qvel - self._propagated(before, [after.time_s])[0].qvel)

    def _meeting(
        self, place: str, before: FreeMotion, after: FreeMotion, between: tuple[float, float], scale: FloatArray
    ) -> Jump:
        """The impact where two flights are nearest to each other, in units of a scale of the coordinates."""
        dofs, weight = self._recordings.dofs, 1.0 / np.maximum(scale, _FLOOR)
        time_s = 0.5 * sum(between)
        for _ in range(3):  # Newton: the distance is quadratic in the time but for the curvature of the flights
            (one,), (other,) = self._propagated(before, [time_s]), self._propagated(after, [time_s])
            apart = self._difference(one.qpos, other.qpos)
            opening = (other.qvel - one.qvel)[dofs] * weight
            time_s -= float(apart[dofs] * weight @ opening) / float(opening @ opening)
            time_s = min(max(time_s, between[0]), between[1])
        (one,), (other,) = self._propagated(before, [time_s]), self._propagated(after, [time_s])
        apart = self._difference(one.qpos, other.qpos)
        qpos = one.qpos.copy()
        mujoco.mj_integratePos(self._model, qpos, apart, 0.5)
        return Jump(place, time_s, qpos, one.qvel, other.qvel, float(np.sqrt(np.mean((apart[dofs] * weight) ** 2))))

    def _difference(self, qpos: FloatArray, other: FloatArray) -> FloatArray:
        """Displacement from some coordinates to others, (nv,)."""
        out = np.empty(self._model.nv)
        mujoco.mj_differentiatePos(self._model, out, 1.0, qpos, other)
        return out

    # ---- Poses

    def _noise(self) -> FloatArray:
        """Standard deviation of the recorded coordinates, (nv,), from third differences: flights have next to none."""
        dofs, thirds = self._recordings.dofs, [np.zeros((0, len(self._recordings.dofs)))]
        for run in self._recordings.runs:
            rates = np.array([self._difference(*pair)[dofs] for pair in pairwise(run.qpos)]).reshape(-1, len(dofs))
            if len(rates) > 2:
                rates *= (np.median(np.diff(run.times)) / np.diff(run.times))[:, None]
                thirds.append(np.diff(rates, n=2, axis=0))
        every = np.concatenate(thirds)
        # The variance of a third difference is 1 + 9 + 9 + 1 of that of a sample; impacts do not move a low quantile.
        sigma = (
            np.quantile(np.abs(every), _QUANTILE, axis=0) / _OF_NORMAL / np.sqrt(20.0) if len(every) else np.zeros(len(dofs))
        )
        noise = np.zeros(self._model.nv)
        noise[dofs] = np.maximum(sigma, _FLOOR)
        return noise

    def _fits(self, run: Recording, noise: FloatArray) -> tuple[list[int], list[_Fit | None]]:
        """Samples after which the impacts of a run happen, from -1 to its last one, and the flights between these."""
        ends = [-1, *self._detected(run, noise), len(run) - 1]
        spans = [
            np.arange(first + 1 + (_SKIPPED if first >= 0 else 0), last + 1 - (_SKIPPED if last < len(run) - 1 else 0))
            for first, last in pairwise(ends)
        ]
        return ends, [self._fitted(run, span, noise) if len(span) >= LEAST_SAMPLES else None for span in spans]

    def _between(
        self, run: Recording, ends: Sequence[int], fits: Sequence[_Fit | None], level: float, scale: FloatArray
    ) -> Iterator[Jump]:
        """Impacts between fitted flights of a run, whose misfits have a usual level; with a scale of the coordinates."""
        reach = (1 + _SKIPPED) * float(np.median(np.diff(run.times)))
        for end, (one, other) in zip(ends[1:], pairwise(fits), strict=False):
            if one is None or other is None:
                self._leave_out(f"a flight has fewer than {LEAST_SAMPLES} samples")
            elif max(one.misfit, other.misfit) > _NOT_FREE * level:
                self._leave_out("no free flight before or after, but a body that slides, rolls or is held")
            else:
                at = 0.5 * float(run.times[end] + run.times[end + 1])
                jump = self._meeting(run.place, one.motion, other.motion, (at - reach, at + reach), scale)
                if jump.apart <= _APART:
                    yield jump
                else:
                    self._leave_out("the flights before and after do not meet")

    def _detected(self, run: Recording, noise: FloatArray) -> list[int]:
        """Samples after which an impact happens: where the velocity jumps by more than its noise."""
        dofs, w = self._recordings.dofs, _WINDOW
        places = range(w, len(run) - w - 1)
        if not places:
            return []
        t = run.times
        jumps = np.array([self._jump(run, k) for k in places])
        expected = 2.0 * noise[dofs] / (w * float(np.median(np.diff(t))))
        # Beside the noise, curvature of the rotation over the windows; impacts do not move a low quantile.
        scale = np.maximum(expected, np.quantile(np.abs(jumps), _QUANTILE, axis=0) / _OF_NORMAL)
        strength = np.abs(jumps / scale).max(axis=1)
        peaks = []
        for k, height in enumerate(strength.tolist()):
            around = strength[max(0, k - w) : k + w + 1]
            if height > _JUMP and height == around.max():
                peaks.append(places[k])
        # Fast rotation bends flights within the windows more than elsewhere: one flight through both sides is no impact.
        return [k for k in peaks if self._fitted(run, self._around(run, k), noise).misfit > _NOT_FREE]

    @staticmethod
    def _around(run: Recording, k: int) -> IntArray:
        """Samples on both sides of an interval, twice as far as the windows."""
        return np.arange(max(0, k - 2 * _WINDOW), min(len(run), k + 2 + 2 * _WINDOW))

    def _jump(self, run: Recording, k: int) -> FloatArray:
        """Jump of the velocity between the samples k and k + 1, from windows on both sides, (ndof,)."""
        t, q, w, dofs = run.times, run.qpos, _WINDOW, self._recordings.dofs
        left = self._difference(q[k - w], q[k]) / (t[k] - t[k - w])
        right = self._difference(q[k + 1], q[k + 1 + w]) / (t[k + 1 + w] - t[k + 1])
        data = self._data
        data.qpos[:], data.qvel[:] = q[k], left
        mujoco.mj_forward(self._model, data)
        span = 0.5 * (t[k + 1 + w] + t[k + 1] - t[k] - t[k - w])
        return np.asarray((right - left - span * data.qacc)[dofs])

    def _fitted(self, run: Recording, span: IntArray, noise: FloatArray) -> _Fit:
        """The flight of some samples, at least as many as a flight has."""
        from scipy.optimize import least_squares

        dofs = self._recordings.dofs
        times, poses = run.times[span], run.qpos[span]
        rates = self._difference(poses[0], poses[_WINDOW]) / (times[_WINDOW] - times[0])
        guess, slopes = np.concatenate([np.zeros(len(dofs)), rates[dofs]]), list[FloatArray]()

        def start(parameters: FloatArray) -> FreeMotion:
            change, qvel, qpos = np.zeros(self._model.nv), np.zeros(self._model.nv), poses[0].copy()
            change[dofs], qvel[dofs] = np.split(parameters, 2)
            mujoco.mj_integratePos(self._model, qpos, change, 1.0)
            return FreeMotion(float(times[0]), qpos, qvel)

        def residuals(parameters: FloatArray) -> FloatArray:
            states = self._propagated(start(parameters), times.tolist())
            pairs = zip(states, poses, strict=True)
            return np.concatenate([self._difference(pose, state.qpos)[dofs] / noise[dofs] for state, pose in pairs])

        def jacobian(parameters: FloatArray) -> FloatArray:
            if len(slopes) < _SLOPES:
                at, steps = residuals(parameters), _DIFFERENCE * np.eye(len(parameters))
                slopes.append(np.stack([(residuals(parameters + one) - at) / _DIFFERENCE for one in steps], axis=1))
            return slopes[-1]

        solved = least_squares(residuals, guess, jacobian, method="lm", xtol=1e-10, ftol=1e-10, max_nfev=_STEPS)
        spare = len(solved.fun) - len(guess)
        fall, weight = self._fall(lambda: residuals(solved.x), solved.fun, slopes[-1])
        return _Fit(start(solved.x), float(np.sqrt(solved.fun @ solved.fun / spare)), fall, weight)

    def _fall(self, residuals: Callable[[], FloatArray], at: FloatArray, slopes: FloatArray) -> tuple[float, float]:
        """What residuals say of the size of gravity beside the state of a flight: the share times its weight, and that."""
        gravity = np.array(self._model.opt.gravity)
        if not gravity.any():
            return 0.0, 0.0
        self._model.opt.gravity = gravity * (1.0 + _DIFFERENCE)
        slope = (residuals() - at) / _DIFFERENCE
        self._model.opt.gravity = gravity
        # Frisch and Waugh: the part of the slope that no change of the state has.
        slope = slope - slopes @ np.linalg.lstsq(slopes, slope)[0]
        return -float(slope @ at), float(slope @ slope)

    def _propagated(self, start: FreeMotion, times: Sequence[float]) -> list[FreeMotion]:
        """States of a flight at some instants, one after the other from its start, onward or back."""
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        states, now = [], start.time_s
        for time_s in times:
            turn = float(np.abs(data.qvel).max()) * abs(time_s - now)
            steps = max(1, math.ceil(min(turn / _TURN_PER_STEP, _MOST_PARTS)))
            model.opt.timestep = (time_s - now) / steps  # RK4 goes back by negative steps
            for _ in range(steps if time_s != now else 0):
                mujoco.mj_step(model, data)
            now = float(time_s)
            states.append(FreeMotion(now, data.qpos.copy(), data.qvel.copy()))
        return states
