"""The simulated system with its columns, and the code that steps it: used by a run and by the replay of its log."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import mujoco
import numpy as np

from ffsm_mj._core.fields import FieldForces
from ffsm_mj._core.steppers import WHOLE_STATE
from ffsm_mj._core.tick import Clock, Sampler
from ffsm_mj.actuation.actuation import Actuation
from ffsm_mj.arrays import FloatArray
from ffsm_mj.balance.balance import Balance
from ffsm_mj.contact_models.grasp.records import GraspRecord
from ffsm_mj.contact_models.interface import EventEffect, EventSource, Scene
from ffsm_mj.dynamics.trajectories import TargetMotion
from ffsm_mj.model.system import System
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.contact_forces import Wrench
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.signals import Signal, coordinate_names, rate_names, unit_of
from ffsm_mj.simulation.control_timing import DelayedControl
from ffsm_mj.simulation.fields import ExternalFields
from ffsm_mj.simulation.integrator import EventDrivenIntegrator
from ffsm_mj.state import entries, fitting

if TYPE_CHECKING:
    from ffsm_mj.sensing.sampler import SensorSampler


class StateSignals:
    """The state in ``data`` as columns.

    Attributes:
        sampler: Updates the tip velocity at each sample, and copies live arrays.
        columns: Columns of the state.
    """

    def __init__(
        self, system: System, data: Any, tip_site: int | None, axes: Sequence[int] = (), target: TargetMotion | None = None
    ) -> None:
        """Bind to a system.

        Args:
            system: The logged system.
            data: Its data, derived quantities current at each sample.
            tip_site: Site of the task; None if there is no task.
            axes: Its world axes.
            target: How its target moves; None: it does not.
        """
        time = np.zeros(1)
        self.sampler = Sampler(system.mj, data, tip=-1 if tip_site is None else tip_site)
        self.columns: tuple[Columns, ...] = (
            Columns((Signal("state", "time_s", "s", "simulation time"),), live=time, on_sample=Clock(time)),
            Columns(_coordinates(system), live=data.qpos),
            Columns(_rates(system), live=data.qvel),
        )
        if tip_site is not None:
            self.columns += (
                Columns(_tip("tip_{}_m", "m", "position of the tip"), live=data.site_xpos[tip_site]),
                Columns(_tip("tip_v{}_m_s", "m/s", "velocity of the tip"), live=self.sampler.twist[3:]),
            )

        self._data, self._axes, self._target, self._place = data, list(axes), target, np.zeros(3)
        if target is not None:
            meaning = "target of the tip, zero along axes that are not regulated"
            signals = _tip("target_{}_m", "m", meaning)
            self.columns += (Columns(signals, live=self._place, on_sample=self._follow),)

    def _follow(self, time_s: float) -> None:
        assert self._target is not None
        self._target.update(time_s, self._data)
        self._place[self._axes] = self._target.position_m


def _coordinates(system: System) -> tuple[Signal, ...]:
    return tuple(
        Signal("state", f"q_{name}", unit_of(name), f"coordinate of {joint.kind} joint {joint.name}", f"joint {joint.name}")
        for joint in sorted(system.joints.values(), key=lambda joint: joint.qpos.start)
        for name in coordinate_names(joint)
    )


def _rates(system: System) -> tuple[Signal, ...]:
    signals = []
    for joint in sorted(system.joints.values(), key=lambda joint: joint.qpos.start):
        frame = ", linear part in world axes, angular part in body axes" if joint.kind == "free" else ""
        meaning = f"rate of {joint.kind} joint {joint.name}{frame}"
        signals += [
            Signal("state", f"v_{name}", unit_of(name), meaning, f"joint {joint.name}") for name in rate_names(joint)
        ]
    return tuple(signals)


def _tip(name: str, unit: str, meaning: str) -> tuple[Signal, ...]:
    return tuple(Signal("state", name.format(axis), unit, meaning) for axis in "xyz")


def event_impulses(model: Any, records: Iterable[Any]) -> Iterator[Wrench]:
    """Impulses of contacts and grasps on the bodies of a model, in N s and N m s."""
    for record in records:
        if isinstance(record, ImpactRecord):
            impulse = record.impulse_N_s * np.array(record.normal) + np.array(record.tangential_impulse_N_s)
            bodies = [int(model.geom(name).bodyid[0]) for name in record.geoms]
            yield from _pair(bodies, np.array(record.point_m), impulse, np.zeros(3), "contact")
        elif isinstance(record, GraspRecord):
            bodies = [int(model.site(name).bodyid[0]) for name in (record.robot_site, record.object_site)]
            angular = np.array(record.angular_impulse_N_m_s)
            yield from _pair(bodies, np.array(record.point_m), np.array(record.impulse_N_s), angular, "grasp")


def _pair(bodies: list[int], point: Any, impulse: Any, angular: Any, by: Literal["contact", "grasp"]) -> Iterator[Wrench]:
    """Equal and opposite impulses on two bodies; the second takes the positive one."""
    yield Wrench(bodies[0], point, -impulse, -angular, by)
    yield Wrench(bodies[1], point, impulse, angular, by)


@dataclass(frozen=True, eq=False)
class Plant:
    """Robot and objects with their actuators, contact models and energy and momentum balance.

    A run advances it from event to event. A log replay integrates it from logged state to logged state, and applies logged
    events. Every (sub-)step and every event is entered in the balance here.

    Attributes:
        scene: Robot and objects with their state, derived quantities current.
        actuation: Actuator limits.
        integrator: Integrates the motion under the contact models.
        balance: Energy and momentum balance.
        state: Columns of the state.
        sampler: Sensors; None: there are none.
        control: Delays of commands and control ticks; None: there are none.
    """

    scene: Scene
    actuation: Actuation
    integrator: EventDrivenIntegrator
    balance: Balance
    state: StateSignals
    sampler: SensorSampler | None = None
    control: DelayedControl | None = None

    @dataclass
    class State:
        """State of MuJoCo, and what the parts remember."""

        data: FloatArray
        numbers: Any
        integrator: Any
        actuation: Any
        balance: Any
        sampler: Any

    def get_state(self) -> State:
        """The state between two steps."""
        state = np.empty(mujoco.mj_stateSize(self.system.mj, WHOLE_STATE))
        mujoco.mj_getState(self.system.mj, self.data, state, WHOLE_STATE)
        sampler = None if self.sampler is None else self.sampler.get_state()
        return self.State(
            state,
            self.scene.numbers.get_state(),
            self.integrator.get_state(),
            self.actuation.get_state(),
            self.balance.get_state(),
            sampler,
        )

    def set_state(self, state: Any) -> None:
        """Go on from a state."""
        saved = entries(state, self.State)
        model, data = self.system.mj, self.data
        values = fitting(saved["data"], (mujoco.mj_stateSize(model, WHOLE_STATE),), "Plant.data")
        mujoco.mj_setState(model, data, values, WHOLE_STATE)
        mujoco.mj_forward(model, data)
        self.scene.numbers.set_state(saved["numbers"])
        self.actuation.set_state(saved["actuation"])
        self.integrator.set_state(saved["integrator"])
        self.balance.set_state(saved["balance"])
        if self.sampler is not None:
            self.sampler.set_state(saved["sampler"])

    @property
    def system(self) -> System:
        """Robot and objects."""
        return self.scene.system

    @property
    def data(self) -> Any:
        """MuJoCo data of the system."""
        return self.scene.data

    @property
    def columns(self) -> list[Columns]:
        """Columns of all parts, in the order of a row."""
        sensing = self.sampler.columns if self.sampler is not None else ()
        return [
            *self.state.columns,
            *self.balance.columns,
            *self.integrator.columns,
            *self.actuation.columns,
            *sensing,
        ]

    def fields_in(self, system: System) -> FieldForces | None:
        """External fields in another system with the same bodies, as a control law knows it; None: there are none."""
        sources = (source for source in self.integrator.sources if isinstance(source, ExternalFields))
        return next((fields.forces_in(system) for fields in sources), None)

    @cached_property
    def after_step(self) -> tuple[Callable[[float], None], ...]:
        """What follows the balance of each (sub-)step, with its duration: counts of valves, and samples of sensors."""
        counts = (self.actuation.elapse,) if self.actuation.counts.size else ()
        return counts if self.sampler is None else (*counts, self.sampler.elapse)

    def advance(self, duration_s: float, *, stepped: bool = False) -> tuple[float, EventSource | None]:
        """Integrate for a time, a sub-step of it, or until the first event, and enter it in the balance.

        Args:
            duration_s: The time, s.
            stepped: Whether the step has been begun in the balance and made already, for all of this time.

        Returns:
            Time integrated in s, and the contact model with an event there; None if there is no event.

        Raises:
            UnsupportedContactError: The motion is too fast for event detection.
            StepLimitError: The motion is too fast for the required accuracy.
        """
        if not stepped:
            self.balance.open()
        elapsed_s, contact_model = self.integrator.advance(duration_s, stepped=stepped)
        self.enter(elapsed_s)
        return elapsed_s, contact_model

    def integrate(self, most_s: float, left_s: float) -> float:
        """Integrate for a time or a sub-step of it without event detection; :meth:`enter` must follow.

        Args:
            most_s: The time.
            left_s: Remaining time of the grid step.

        Returns:
            Time integrated in s.

        Raises:
            StepLimitError: The motion is too fast for the required accuracy.
        """
        self.balance.open()
        return self.integrator.integrate(most_s, left_s)

    def continue_step(self, duration_s: float) -> None:
        """Integrate further, as a part of the step before; see :meth:`EventDrivenIntegrator.continue_step`."""
        self.balance.open()
        self.integrator.continue_step(duration_s)

    def enter(self, elapsed_s: float, *, is_set: bool = False) -> None:
        """Enter the finished (sub-)step in the balance, and take the samples of sensors that are due in it.

        Args:
            elapsed_s: Its duration; no effect if it is not positive.
            is_set: Whether :meth:`set_coordinates` has replaced the state at its end.
        """
        if elapsed_s <= 0.0:
            return
        self.balance.close(elapsed_s)
        for exchange in self.integrator.exchanges(elapsed_s):
            self.balance.enter(exchange)
        if is_set:
            # Sensors, columns and records need the forces of contacts, limits and latches at this state. Not before the
            # exchanges, which are sums over the stages of the step: this evaluation is none of them.
            self.integrator.motion.refresh_forces()
        for elapse in self.after_step:
            elapse(elapsed_s)

    def apply(self, event: Callable[[], EventEffect | None], state_after: FloatArray | None = None) -> EventEffect | None:
        """Apply an event: it changes the state in ``data``, is entered in the balance, and may change the motion.

        Args:
            event: Applies the event to the state, and returns its effect; None if there is no event after all.
            state_after: Coordinates and rates to set after it, (nq + nv,); None keeps those that the event leaves.
        """
        # The balance separates robot and object at the event itself; a grasped object counts with the robot only in steps.
        self.balance.set_grasped_object(None)
        before, motion = self.data.qvel.copy(), self.integrator.motion
        effect = event()
        if effect is not None:
            for contact_model in self.integrator.event_sources:
                contact_model.on_records(effect.records)
        moved = effect.motion if effect is not None else None
        if moved is not None:
            self.integrator.bind(moved)
        if state_after is not None:
            self.set_coordinates(state_after)
        if state_after is not None or moved is None:
            self.integrator.restart()
        self.balance.set_grasped_object(self.integrator.motion.grasped_object)
        if self.sampler is not None and effect is not None and not np.array_equal(before, self.data.qvel):
            impulses = event_impulses(self.system.mj, effect.records)
            self.sampler.add_impulses(motion, self.data.qvel - before, tuple(impulses))
        if effect is not None and effect.exchange is not None:
            self.balance.enter(effect.exchange)
        return effect

    def state_now(self) -> FloatArray:
        """Coordinates and rates in ``data``, (nq + nv,), a copy."""
        data = self.data
        state, nq = np.empty(len(data.qpos) + len(data.qvel)), len(data.qpos)
        state[:nq], state[nq:] = data.qpos, data.qvel
        return state

    def set_coordinates(self, state: FloatArray) -> None:
        """Set coordinates and rates, (nq + nv,), and update what follows but applied forces; the motion follows too."""
        model, data = self.system.mj, self.data
        data.qpos[:], data.qvel[:] = np.split(state, [model.nq])
        if not np.isfinite(data.qacc_warmstart).all():  # absurd logged efforts may have left non-finite values
            data.qacc_warmstart.fill(0.0)
        mujoco.mj_forward(model, data)
        self.integrator.motion.sync_from_system()
        self.integrator.motion.stepper.clear(math.inf)
