"""Transfer of the base by two impulses: onto the orbit that meets a point in LVLH at a time, and to rest there.

The plan is exact for two Kepler orbits: with the present position r and velocity v of the mass centre of the robot, Newton's
method finds the velocity with which the orbit through R + r is at R(t_f) + A(t_f) p at the time of arrival (Clohessy and
Wiltshire's equations are the linear case of a circular orbit). The first burn makes the velocity to go zero, while it is
planned anew at every tick from where the robot is by then: velocity-to-be-gained guidance. Then the robot coasts. The second
burn, to rest relative to LVLH, is centred on the time of arrival. A burn ends with the first tick in which the thrusters can
give all of the velocity to go. Thrust passes through the mass centre.

Source: Battin 1999, An Introduction to the Mathematics and Methods of Astrodynamics, sec. 11.7 (velocity to be gained);
Fehse 2003, Automated Rendezvous and Docking of Spacecraft, ch. 3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import mujoco
import numpy as np
from pydantic import Field, PositiveFloat

from ffsm_controllers.allocation import ThrusterAllocation, actuators_by_name
from ffsm_mj.controller_protocol import (
    Command,
    ControllerContext,
    ControllerReport,
    Fault,
    FloatArray,
    IntArray,
    KeplerOrbit,
    LvlhAxes,
    Observation,
    ScenarioFaults,
    Signal,
    Stateful,
    StrictModel,
    cross,
)

_BURN, _COAST, _BRAKE, _DONE = range(4)
_STEP_M_S = 0.1
"""Difference of velocities for the Jacobian: rounding of a position, 1e-9 m, over the way in a second is 1e-8 of it."""
_ITERATIONS = 4
"""Of Newton's method with one Jacobian, each of which takes four digits or more: the relative motion is almost linear."""


class TransferConfig(StrictModel):
    """The base moves to a point in LVLH by two impulses, and comes to rest there."""

    kind: Literal["transfer"]
    thrusters: Annotated[tuple[str, ...], Field(min_length=1)]
    """Actuators that push the base: body-fixed at sites, or ideal ones on base joints."""
    position_m: tuple[float, float, float]
    """Where the origin of the base's frame is to be, LVLH axes at the time of arrival, m."""
    duration_s: PositiveFloat
    """From the start of the phase to the arrival, s; less than half a period of the orbit."""
    plan: Literal["orbit", "straight"] = "orbit"
    """``orbit``: two Kepler orbits. ``straight``: a straight line in world axes to where the point is in them at the start,
    as if there were neither field nor rotation: what a plan without an orbit misses by."""


class Transfer(Stateful):
    """Two-impulse transfer."""

    @dataclass
    class State:
        """Start of the phase, s; stage; whether a burn ends with this tick; reports; centre of mass against the base, m."""

        start_s: float
        stage: int
        ends: bool
        report: tuple[float, float]
        arrival: tuple[float, float]
        lever: FloatArray

    Config = TransferConfig
    telemetry_signals: ClassVar[tuple[Signal, ...]] = (
        Signal("controller", "transfer_to_go_m_s", "m/s", "velocity to go: to the planned orbit, then to rest"),
        Signal("controller", "transfer_miss_m", "m", "distance by which the robot misses the point without further thrust"),
    )

    def __init__(self, config: TransferConfig, context: ControllerContext) -> None:
        """Resolve the thrusters.

        Raises:
            ScenarioFaults: No orbit, an unknown name, or a duration of half a period and more.
        """
        if context.orbit is None:
            raise ScenarioFaults([Fault("transfer needs 'environment.orbit'", ("kind",))])
        half = math.pi / context.orbit.rate_rad_s
        if config.duration_s >= half:
            raise ScenarioFaults([Fault(f"must be less than half a period, {half:.6g} s", ("duration_s",))])
        self._config, self._orbit, self._period_s = config, context.orbit, context.control_period_s
        system, model = context.system, context.system.mj
        self._root, self._mass = system.robot.root, float(model.body_subtreemass[system.robot.root])
        self._axes, self._linear = LvlhAxes(context.orbit), np.empty((3, model.nv))
        self._model = model
        self.driven_actuators: IntArray = actuators_by_name(system, config.thrusters, "thrusters")
        self._allocation = ThrusterAllocation(system, self.driven_actuators)
        low, high = np.tile([[-np.inf], [np.inf]], model.nu)
        if context.limits is not None:
            low, high = context.limits.bounds(np.zeros(model.nu))
        self._low, self._high = low[self.driven_actuators], high[self.driven_actuators]
        self._start_s, self._stage, self._ends = 0.0, _BURN, False
        self._report, self._arrival, self._lever = (math.nan, math.nan), (math.nan, math.nan), np.zeros(3)

    def start(self, observation: Observation) -> None:
        """Begin with the first burn."""
        data = observation.data
        self._start_s, self._stage, self._ends = observation.phase_start_s, _BURN, False
        self._axes.update(observation.time_s)
        # The base keeps its attitude in LVLH, and the mass centre its place in the base.
        self._lever[:] = (data.subtree_com[self._root] - data.xpos[self._root]) @ self._axes.axes

    def control(self, observation: Observation, command: Command) -> None:
        """Burn, coast, or brake."""
        data, time_s = observation.data, observation.time_s
        mujoco.mj_jacSubtreeCom(self._model, data, self._linear, self._root)
        r, v = data.subtree_com[self._root], self._linear @ data.qvel
        left_s = self._start_s + self._config.duration_s - time_s
        if self._ends and observation.at_tick:
            self._end_burn(time_s, r)
        to_go, miss = np.zeros(3), math.nan
        if self._stage in (_BURN, _COAST):
            to_go, at_end, miss = self._plan(time_s, max(left_s, self._period_s), r, v)
            if left_s <= 0.5 * self._period_s / self._efforts(data, at_end)[1]:
                self._stage, self._arrival = _BRAKE, (miss, self._arrival[1])
        if self._stage == _BRAKE:
            self._axes.update(time_s)
            to_go = cross(self._axes.spin, r) - v
        efforts = np.zeros(len(self.driven_actuators))
        if self._stage in (_BURN, _BRAKE):
            efforts, share = self._efforts(data, to_go)
            self._ends = share == 1.0
        self._report = float(np.linalg.norm(to_go)), miss
        command.drive(self.driven_actuators, efforts)

    def _end_burn(self, time_s: float, r: FloatArray) -> None:
        self._ends = False
        if self._stage == _BRAKE:
            self._axes.update(time_s)
            error = r @ self._axes.axes - self._lever - self._config.position_m
            self._arrival = self._arrival[0], float(np.linalg.norm(error))
        self._stage = _COAST if self._stage == _BURN else _DONE

    def _plan(self, time_s: float, left_s: float, r: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Velocity to go, velocity to lose at the arrival, in world axes, m/s, (3,) each; and the miss without a burn, m."""
        target_lvlh = self._config.position_m + self._lever
        if self._config.plan == "straight":
            self._axes.update(self._start_s)
            target = self._axes.axes @ target_lvlh
            wanted = (target - r) / left_s
            return wanted - v, -wanted, float(np.linalg.norm(r + left_s * v - target))
        R, V = self._orbit.reference.state(time_s)
        self._axes.update(time_s + left_s)
        end, end_speed = self._orbit.reference.state(time_s + left_s)
        target = self._axes.axes @ target_lvlh

        def arrival(velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
            return KeplerOrbit(self._orbit.mu, R + r, V + velocity).state(left_s)

        first, _ = arrival(v)
        miss = first - end - target
        J = np.column_stack([(arrival(v + _STEP_M_S * axis)[0] - first) / _STEP_M_S for axis in np.eye(3)])
        wanted, rest = v.copy(), miss
        for _ in range(_ITERATIONS):
            wanted = wanted - np.linalg.solve(J, rest)
            place, speed = arrival(wanted)
            rest = place - end - target
        return wanted - v, cross(self._axes.spin, target) - (speed - end_speed), float(np.linalg.norm(miss))

    def _efforts(self, data: Any, to_go: FloatArray) -> tuple[FloatArray, float]:
        """Efforts of the thrusters for a change of velocity in a tick, or as much of it as limits allow; and that share."""
        force = self._mass / self._period_s * to_go
        lever = data.subtree_com[self._root] - data.xpos[self._root]
        efforts = self._allocation.efforts(data, force, cross(lever, force))
        room, used = np.where(efforts > 0.0, self._high, -self._low), efforts != 0.0
        share = min(1.0, float((room[used] / np.abs(efforts[used])).min(initial=1.0)))
        return share * efforts, share

    def is_finished(self, time_s: float) -> bool:  # noqa: ARG002
        """Whether the robot is at rest in LVLH."""
        return self._stage == _DONE

    def telemetry(self) -> Sequence[float]:
        """Velocity to go and predicted miss at the last tick."""
        return self._report

    def summary(self) -> ControllerReport:
        """Where it arrived."""
        names = ("miss_before_braking_m", "arrival_error_m")
        return {name: value for name, value in zip(names, self._arrival, strict=True) if math.isfinite(value)}
