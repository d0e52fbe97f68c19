"""Actuators in the stages of a step: activations, kinks of forces, impulse and work of external servos.

A controller stops to integrate its error e beyond a limit of the integral z, until e changes its sign: kinks at |z| at its
limit and at e = 0. Its voltage v = (R / K) tau + K ldot reaches a limit, the rate of the current another one, and the LuGre
friction of a motor has |ldot|, with a kink where the motor reverses. The curves of a muscle's force over its length L and
rate V, both scaled, are parabolas that meet with one tangent: a step through them would have the order three.

Activations of actuators in the stages of a step: filters and integrators as functions of the time, others by quadrature.

The activation w of a filter with the time constant tau is u + (w_0 - u) exp(-t / tau) while its control u is constant,
that of an integrator w_0 + u t within its range, and a setpoint of limited rate moves to u as fast as it may. Those of
muscles, motors and controllers with an integral are further components of the state, with the rates that MuJoCo gives them.
MuJoCo's own RK4 is of order one in most of these.

Kinks of forces: the instant in a step at which a force reaches its limit, or leaves it, or a tendon's spring its dead band.

A force within its limits is a smooth function of the state, and at them it has a kink, which a step of order four must not
contain: the step ends there. The functions whose roots are sought are the forces without limits less these, and lengths of
tendons less the ends of the dead bands of their springs.

Servos that act from outside, at a site without reference site or on a free joint: their impulse and work in a step.

Both are integrals over the stages of the step, as the force of a servo varies within it: of the wrench about the world
origin, and of its power p . ldot.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.dynamics.step_path import StepPath
from ffsm_mj.model.actuators import (
    INTEGRAL_LIMIT,
    SLEW_RATE,
    controllers_of,
    servo_mask,
    without_force_limits,
    without_joint_limits,
)
from ffsm_mj.model.inputs import signature_inputs
from ffsm_mj.model.system import tendon_stiffness_coefficients
from ffsm_mj.tolerances import EVENT_TIME, EVENT_TIME_S

_DC, _PID = mujoco.mjtGain.mjGAIN_DCMOTOR, mujoco.mjtGain.mjGAIN_PID
_AT_ROOT, _SMALL = 1e-9, 1e-12
"""Values this close to zero are zero: relative to the limit, and of errors, lengths and rates in their units."""


class MotorKinks:
    """Functions with a sign change at each kink of the controllers, motors and muscles of a model.

    Attributes:
        rounding: Size below which each is zero, (n,).
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Bind to a model and its data."""
        self._model, self._data = model, data
        motors, slews, integrals = controllers_of(model, _DC)
        others, _, more = controllers_of(model, _PID)
        both, places = np.concatenate((motors, others)), np.concatenate((integrals, more))
        self._limits = model.actuator_gainprm[both, INTEGRAL_LIMIT]
        limited = (self._limits > 0.0) & (places >= 0)
        self._limits, self._integrals = self._limits[limited], places[limited]
        driven = (model.actuator_gainprm[motors, 7] > 0.0) & (model.actuator_gainprm[motors, 1] > 0.0)
        self._drives = [tuple(row) for row in np.stack((motors, slews, integrals), axis=1)[driven].tolist()]
        self._voltages = model.actuator_gainprm[motors[driven], 7]
        currents = motors[(model.actuator_dynprm[motors, 1] > 0.0) & (model.actuator_dynprm[motors, 0] > 0.0)]
        # The current is the last activation of a motor that has one.
        self._currents = model.actuator_actadr[currents] + model.actuator_actnum[currents] - 1
        self._rates = model.actuator_dynprm[currents, 1]
        self._bristles = motors[model.actuator_biasprm[motors, 3] > 0.0]
        self._unlimited = without_force_limits(model)
        self._unlimited.actuator_dynprm[currents, 1] = 0.0
        self._muscles, self._length_joints, self._rate_joints = _muscle_curves(model)
        ends = np.concatenate((self._limits, np.repeat(self._voltages, 2), np.repeat(self._rates, 2)))
        of_muscles = self._length_joints.size + self._rate_joints.size
        small = np.full(len(self._limits) + len(self._bristles) + of_muscles, _SMALL)
        self.rounding = np.concatenate((_AT_ROOT * ends, small))

    def __bool__(self) -> bool:
        """Whether the model has any."""
        return bool(len(self.rounding))

    def values(self) -> FloatArray:
        """Their values at the state in the data, forces current, (n,)."""
        data = self._data
        voltages, errors = self._drive_voltages(), data.act_dot[self._integrals]
        rates = np.zeros(0)
        if len(self._currents):
            mujoco.mj_fwdActuation(self._unlimited, data)
            rates = data.act_dot[self._currents]
            mujoco.mj_fwdActuation(self._model, data)
        return np.concatenate(
            (
                np.abs(data.act[self._integrals]) - self._limits,
                np.stack((voltages - self._voltages, voltages + self._voltages), axis=1).ravel(),
                np.stack((rates - self._rates, rates + self._rates), axis=1).ravel(),
                errors,
                data.actuator_velocity[self._bristles],
                np.ravel(data.actuator_length[self._muscles, None] - self._length_joints),
                np.ravel(data.actuator_velocity[self._muscles, None] - self._rate_joints),
            )
        )

    def _drive_voltages(self) -> FloatArray:
        """Voltages of the controllers of motors without limit, V."""
        model, data, voltages = self._model, self._data, []
        for i, slew, integral in self._drives:
            resistance, constant, _, _, kp, ki, kd = model.actuator_gainprm[i, :7].tolist()
            inputs, tokens = dict.fromkeys(("pos", "vel", "ff"), 0.0), signature_inputs(_DC, model.actuator_ctrlspec[i])
            for at, token in enumerate(tokens, i):
                low, high = model.actuator_ctrlrange[at].tolist()
                inputs[token] = float(data.ctrl[at])
                if model.actuator_ctrllimited[at]:
                    inputs[token] = min(max(inputs[token], low), high)
            if slew >= 0:
                inputs[tokens[0]] = float(data.act[slew])
            rate = float(data.actuator_velocity[i])
            torque = kd * (inputs["vel"] - rate) + inputs["ff"]
            torque += kp * (inputs["pos"] - float(data.actuator_length[i]))
            torque += ki * float(data.act[integral]) if integral >= 0 else 0.0
            voltages.append(resistance / constant * torque + constant * rate)
        return np.array(voltages)


def _muscle_curves(model: Any) -> tuple[IntArray, FloatArray, FloatArray]:
    """Muscles of a model, and the lengths and rates at which two parts of their curves meet, (n,), (n, 5) and (n, 3).

    The active force over L rises from lmin by two parabolas to L = 1, and falls by two to lmax; the passive one begins at 1.
    That over V rises from -1 by a parabola to V = 0, and by another one to fvmax - 1 (mju_muscleGain, mju_muscleBias).
    """
    of_gain = model.actuator_gaintype == int(mujoco.mjtGain.mjGAIN_MUSCLE)
    muscles = np.flatnonzero(of_gain | (model.actuator_biastype == int(mujoco.mjtBias.mjBIAS_MUSCLE)))
    parameters = np.where(of_gain[muscles, None], model.actuator_gainprm[muscles], model.actuator_biasprm[muscles])
    low, high, _, _, lmin, lmax, vmax, _, fvmax = parameters[:, :9].T
    start, end = model.actuator_lengthrange[muscles].T
    unit, one = (end - start) / np.maximum(high - low, _SMALL), np.ones(len(muscles))
    lengths = np.stack((lmin, 0.5 * (lmin + 1.0), one, 0.5 * (1.0 + lmax), lmax), axis=1)
    rates = np.stack((-one, 0.0 * one, fvmax - 1.0), axis=1)
    return muscles, start[:, None] + (lengths - low[:, None]) * unit[:, None], rates * (unit * vmax)[:, None]


_INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
_FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
_FULL = 1.0 - 1e-9
"""An integral this close to its limit, relative to it, is at the limit."""


class Activations:
    """Activations of a model in the stages of a step.

    Attributes:
        kink_s: Time from the start of the step at which an integrator reaches the end of its range, or a setpoint its
            target, s; infinite without.
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Bind to a model and its data."""
        self._model, self._data, self.kink_s = model, data, math.inf
        single = np.flatnonzero(model.actuator_actnum == 1)
        kinds = model.actuator_dyntype[single]
        filters, integrators = single[np.isin(kinds, _FILTERS)], single[kinds == _INTEGRATOR]
        self._filters, self._filter_controls = model.actuator_actadr[filters], model.actuator_ctrladr[filters]
        self._taus = np.maximum(model.actuator_dynprm[filters, 0], float(mujoco.mjMINVAL))
        self._integrals, self._integral_limits, slewing, setpoints = _controllers(model)
        # Both are ramps: an integrator at the rate of its control, a setpoint at its own.
        ramps = np.concatenate((integrators, slewing))
        self._ramps, self._ramp_controls = model.actuator_actadr[ramps], model.actuator_ctrladr[ramps]
        self._ramps[len(integrators) :], self._slews = setpoints, slice(len(integrators), None)
        self._slew_rates = model.actuator_gainprm[slewing, SLEW_RATE]
        limited = model.actuator_actlimited[ramps].astype(bool)
        self._low, self._high = np.where(limited[:, None], model.actuator_actrange[ramps], [-np.inf, np.inf]).T
        self._start, self._full = np.array(data.act), self._integrals[:0]
        self._sum, self._last = np.zeros(model.na), np.zeros(model.na)
        self._nodes = np.zeros((0, model.na))
        self._kinks, self._values = MotorKinks(model, data), np.zeros(0)

    def __bool__(self) -> bool:
        """Whether there is anything to do in the stages, or a kink to be found."""
        return bool(len(self._start)) or bool(self._kinks)

    def begin(self, duration_s: float, nodes: int = 0) -> None:
        """Begin a step at the state in the data, forces current; with the number of nodes if it is implicit."""
        model, data = self._model, self._data
        limited = model.actuator_ctrllimited.astype(bool)
        controls = np.where(limited, np.clip(data.ctrl, *model.actuator_ctrlrange.T), data.ctrl)
        self._targets, self._slopes = controls[self._filter_controls], controls[self._ramp_controls]
        self._start[:] = data.act
        starts, slews = self._start[self._ramps], self._slews
        targets = self._slopes[slews].copy()
        self._slopes[slews] = self._slew_rates * np.sign(targets - starts[slews])
        self._low[slews], self._high[slews] = np.minimum(starts[slews], targets), np.maximum(starts[slews], targets)
        # A ramp has a kink where it ends, at the end of its range or at its target: a step of order four must end there.
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (np.where(self._slopes > 0.0, self._high, self._low) - starts) / self._slopes
        inside = reach[(reach > 0.0) & (reach < duration_s)]
        self.kink_s = float(inside.min(initial=math.inf))
        integrals, errors = self._start[self._integrals], data.act_dot[self._integrals]
        self._full = self._integrals[(np.abs(integrals) >= _FULL * self._integral_limits) & (errors * integrals > 0.0)]
        if self._kinks:
            self._values = self._kinks.values()
        self._sum.fill(0.0)
        self._nodes = np.tile(self._stopped(data.act_dot), (nodes, 1))

    def is_kinked(self, duration_s: float) -> bool:
        """Whether the step of a duration that ends at the state in the data, forces current, has a kink inside."""
        if self.kink_s < duration_s:
            return True
        if not self._kinks:
            return False
        beyond = np.abs(self._values) > self._kinks.rounding
        return bool((beyond & (self._values * self._kinks.values() < 0.0)).any())

    def _stopped(self, rates: FloatArray) -> FloatArray:
        """Rates of activations in this step: an integral at its limit stays there, (na,)."""
        rates = rates.copy()
        rates[self._full] = 0.0
        return rates

    def move_to(self, after_s: float, others: FloatArray | None = None) -> None:
        """Set the activations at a stage.

        Args:
            after_s: Time since the start of the step, s.
            others: Increments of those without a closed form, (na,); None: by their rates at the last stage.
        """
        act = self._data.act
        act[:] = self._start + (after_s * self._last if others is None else others)
        decay = np.exp(-after_s / self._taus)
        act[self._filters] = self._targets + (self._start[self._filters] - self._targets) * decay
        act[self._ramps] = np.clip(self._start[self._ramps] + after_s * self._slopes, self._low, self._high)

    def add(self, weight: float) -> None:
        """Add the rates of a stage with its weight."""
        self._last[:] = self._stopped(self._data.act_dot)
        self._sum += weight * self._last

    def end(self, duration_s: float) -> None:
        """Set the activations at the end of an explicit step."""
        self.move_to(duration_s, duration_s * self._sum)

    def move_to_node(self, after_s: float, weights: FloatArray) -> None:
        """Set the activations at a node of an implicit step, with the weights of the nodes' rates in it, s."""
        self.move_to(after_s, weights @ self._nodes)

    def set_node(self, node: int) -> float:
        """Store the rates at a node; returns by how much they have changed."""
        rates = self._stopped(self._data.act_dot)
        change = float(np.abs(rates - self._nodes[node]).max(initial=0.0))
        self._nodes[node] = rates
        return change


def _controllers(model: Any) -> tuple[IntArray, FloatArray, IntArray, IntArray]:
    """Addresses of the integrals of controllers and their limits, infinite without; actuators and addresses of setpoints."""
    both = [controllers_of(model, kind) for kind in (mujoco.mjtGain.mjGAIN_PID, mujoco.mjtGain.mjGAIN_DCMOTOR)]
    ids, slews, integrals = (np.concatenate(parts) for parts in zip(*both, strict=True))
    limits = model.actuator_gainprm[ids, INTEGRAL_LIMIT]
    limits = np.where(limits > 0.0, limits, np.inf)
    return integrals[integrals >= 0], limits[integrals >= 0], ids[slews >= 0], slews[slews >= 0]


_AT_LIMIT = 1e-9
"""A force this close to a limit, relative to it, is at the limit: a step that begins there has passed the kink."""


class DeadBands:
    """Ends of the dead bands of the springs of a model's tendons; where a length passes one its force has a kink."""

    def __init__(self, model: Any, data: Any) -> None:
        """Bind to a model and its data."""
        low, high = model.tendon_lengthspring.T
        self._data = data
        self._ids = np.flatnonzero(tendon_stiffness_coefficients(model).any(axis=1) & (low < high))
        self._ends = model.tendon_lengthspring[self._ids]
        self.rounding = np.full(self._ends.size, _SMALL)

    def __bool__(self) -> bool:
        """Whether the model has any."""
        return bool(len(self._ids))

    def values(self) -> FloatArray:
        """Lengths less the two ends of their bands, positions in the data current, (2 n,)."""
        return np.ravel(self._data.ten_length[self._ids, None] - self._ends)

    def are_passed(self, before: FloatArray) -> bool:
        """Whether a length has passed an end of its band since these values."""
        return bool(((np.abs(before) > self.rounding) & (before * self.values() < 0.0)).any())


class ForceLimits:
    """Limits of the servos of a model, and of the joints and tendons that they act on; and the other kinks of its forces.

    Attributes:
        servos: Servos with a ``forcerange``, (n,).
        dofs: Degrees of freedom with an ``actuatorfrcrange``, (m,).
        ranges: Least and greatest force of each of them, (n, 2).
        dof_ranges: The same of the degrees of freedom, (m, 2).
    """

    def __init__(self, model: Any, data: Any) -> None:
        """Bind to a model and its data."""
        self._model, self._data = model, data
        self.servos = np.flatnonzero(servo_mask(model) & model.actuator_forcelimited.astype(bool))
        limited = model.jnt_actfrclimited.astype(bool)
        self.dofs = np.array(model.jnt_dofadr[limited], dtype=np.intp)
        self.ranges = np.ascontiguousarray(model.actuator_forcerange[self.servos], dtype=np.float64)
        self.dof_ranges = np.ascontiguousarray(model.jnt_actfrcrange[limited], dtype=np.float64)
        self._unlimited, self._without_joints = without_force_limits(model), without_joint_limits(model)
        sizes = np.concatenate((np.abs(self.ranges), np.abs(self.dof_ranges)))
        self._motors = MotorKinks(model, data)
        self._bands = DeadBands(model, data)
        rounding = _AT_LIMIT * np.repeat(sizes.max(axis=1, initial=0.0), 2)
        self._rounding = np.concatenate((rounding, self._motors.rounding, self._bands.rounding))

    def _margins(self) -> FloatArray:
        """Forces without limits less their least and greatest values, and the functions of the other kinks."""
        data = self._data
        mujoco.mj_fwdActuation(self._unlimited, data)
        forces = data.actuator_force[self.servos]
        mujoco.mj_fwdActuation(self._without_joints, data)
        totals = data.qfrc_actuator[self.dofs]
        mujoco.mj_fwdActuation(self._model, data)
        of_dofs = (totals[:, None] - self.dof_ranges).ravel()
        of_servos = (forces[:, None] - self.ranges).ravel()
        return np.concatenate((of_servos, of_dofs, self._motors.values(), self._bands.values()))

    def first_kink(self, path: StepPath, duration_s: float) -> float | None:
        """Time in a step of the first kink of a force, or None; the path is left at its start.

        Args:
            path: The step.
            duration_s: How much of it, s.
        """
        from scipy.optimize import brentq  # takes a second to import: only runs with kinks pay

        path.move_to(duration_s)
        end = self._margins()
        path.move_to(0.0)
        start, until_s = self._margins(), duration_s

        def margin(time_s: float, which: int) -> float:
            path.move_to(time_s)
            return float(self._margins()[which])

        for i in np.flatnonzero((start * end < 0.0) & (np.abs(start) > self._rounding)).tolist():
            if margin(until_s, i) * start[i] < 0.0:
                until_s = float(brentq(margin, 0.0, until_s, args=(i,), xtol=EVENT_TIME_S, rtol=EVENT_TIME))
        path.move_to(0.0)
        return until_s if until_s < duration_s else None


_SITE = int(mujoco.mjtTrn.mjTRN_SITE)


class ExternalServos:
    """Impulse and work of the servos that act from outside.

    Attributes:
        impulse: Impulse on each tree in the last step, (P, L about the world origin), (number of trees, 6).
    """

    def __init__(self, model: Any, data: Any, servos: IntArray, trees: IntArray, impulse: FloatArray) -> None:
        """Bind to the data of a motion.

        Args:
            model: MuJoCo model of the motion.
            data: Its data.
            servos: Ids of the servos, (n,).
            trees: Tree that each acts on, (n,).
            impulse: Receives the impulse, (number of trees, 6).
        """
        self._model, self._data, self.impulse = model, data, impulse
        self._servos = [*zip(servos.tolist(), trees.tolist(), strict=True)]
        self._sums = np.zeros((len(impulse), 7))

    def begin(self) -> None:
        """Begin a step."""
        self._sums.fill(0.0)

    def add(self, weight: float) -> None:
        """Add wrench and power at a stage, forces current, with its weight."""
        data = self._data
        for i, tree in self._servos:
            force = weight * float(data.actuator_force[i])
            self._sums[tree, :6] += force * self._wrench(i)
            self._sums[tree, 6] += force * float(data.actuator_velocity[i])

    def end(self, duration_s: float, work: FloatArray) -> None:
        """End a step, and add the work to that of each tree, J, (number of trees,)."""
        self.impulse[:] = duration_s * self._sums[:, :6]
        work += duration_s * self._sums[:, 6]

    def _wrench(self, servo: int) -> FloatArray:
        """Wrench about the world origin per unit of force, (6,)."""
        model, data, target = self._model, self._data, int(self._model.actuator_trnid[servo, 0])
        push, turn = model.actuator_gear[servo].reshape(2, 3)
        if model.actuator_trntype[servo] == _SITE:
            axes, place = data.site_xmat[target].reshape(3, 3), data.site_xpos[target]
            push = axes @ push
        else:  # a free joint: the force is in world axes, the torque in those of the body
            body = int(model.jnt_bodyid[target])
            axes, place = data.xmat[body].reshape(3, 3), data.xpos[body]
        return np.concatenate((push, axes @ turn + np.cross(place, push)))
