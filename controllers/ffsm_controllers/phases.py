"""The phase machine: a controller made of controllers, one per phase of the task (paper, Fig. 2)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from numbers import Integral, Real
from typing import Any, cast

import numpy as np

from ffsm_controllers.endings import Ending
from ffsm_controllers.parts import Parts
from ffsm_mj._core.osdre import CommandingLaw
from ffsm_mj.arrays import compact
from ffsm_mj.controller_protocol import (
    Columns,
    Command,
    Controller,
    ControllerError,
    ControllerReport,
    ExternalCommand,
    LawInCore,
    Observation,
    OfCore,
    PhaseRecord,
    Signal,
    Summarises,
    entries,
    with_state,
)


@dataclass(frozen=True)
class Phase:
    """One phase.

    Attributes:
        name: Name in the scenario.
        kind: Kind of its controller; with several parts ``name: kind`` of each.
        controller: What drives the robot in it.
        endings: What ends it, in the order in which they count at one instant.
        arm: Names of the grasps that may close while it lasts.
        release: Names of those that let go as it begins.
        by_grasp: The same law made for the systems in which objects are held, by the name of the grasp.
    """

    name: str
    kind: str
    controller: Controller
    endings: tuple[Ending, ...] = ()
    arm: tuple[str, ...] = ()
    release: tuple[str, ...] = ()
    by_grasp: Mapping[str, Controller] = field(default_factory=dict)

    def law(self, grasp: str) -> Controller:
        """The controller of the system in which a grasp is closed; empty: the free one."""
        return self.by_grasp[grasp] if grasp else self.controller


class PhaseMachine:
    """Runs phases from the first one on: each leads to the next, or to another, which may have been there before.

    Attributes:
        phases: The phases in their order.
        given: Command of the program that steps the simulation: phases begin and end, and their controllers are asked only
            for actuators that it leaves to them.
    """

    def __init__(self, phases: Sequence[Phase]) -> None:
        """Collect what the phases report: a signal that several share is one column."""
        self.phases = tuple(phases)
        signals: dict[str, Signal] = {}
        for phase in self.phases:
            signals |= {signal.key: signal for signal in phase.controller.telemetry_signals}
        column = {key: i for i, key in enumerate(signals)}
        self._columns = [compact([column[s.key] for s in phase.controller.telemetry_signals]) for phase in self.phases]
        self.telemetry = np.full(len(signals), np.nan)
        self._live_index = np.full(1, -1.0)
        index = Signal("phase", "index", "", "position of the phase in the scenario, from 0")
        self.columns: tuple[Columns, ...] = (
            Columns(tuple(signals.values()), live=self.telemetry),
            Columns((index,), live=self._live_index),
        )
        self.external: ExternalCommand | None = None
        self.phase_index = -1
        self._start_s = 0.0
        self._begun: list[PhaseRecord] = []
        self._current: PhaseRecord | None = None
        self._begins_again = False
        self._grasp = ""
        self._requests: list[str] = []
        self._asked: dict[tuple[int, str], Controller] = {}
        self._keys = list(signals)
        self._laws = {
            (i, grasp): with_state(law, f"the control law {phase.kind!r} of phase {phase.name!r}")
            for i, phase in enumerate(self.phases)
            for grasp, law in (("", phase.controller), *phase.by_grasp.items())
        }
        self._endings = {
            (i, k): with_state(ending.trigger, f"an ending of phase {phase.name!r}")
            for i, phase in enumerate(self.phases)
            for k, ending in enumerate(phase.endings)
        }

    @dataclass
    class State:
        """Where the phases have come to, and what laws and endings remember.

        Attributes:
            phase_index: Position of the phase under way, from 0; -1: none has begun.
            start_s: Time at which it began, s.
            current: Record of its beginning.
            begins_again: Whether its law begins at the next call.
            grasp: Name of the grasp for whose system the law in charge is made; empty: none.
            asked: Laws that have been in charge: position of the phase, name of the grasp.
            telemetry: Values of the columns by key.
            laws: States of the laws, by position of the phase and name of the grasp.
            endings: States of the endings, by position of the phase and place in it.
        """

        phase_index: int
        start_s: float
        current: Any
        begins_again: bool
        grasp: str
        asked: list[tuple[int, str]]
        telemetry: dict[str, float]
        laws: dict[tuple[int, str], Any]
        endings: dict[tuple[int, int], Any]

    def get_state(self) -> State:
        """Where the phases have come to, and what laws and endings remember."""
        return self.State(
            self.phase_index,
            self._start_s,
            None if self._current is None else asdict(self._current),
            self._begins_again,
            self._grasp,
            list(self._asked),
            dict(zip(self._keys, self.telemetry.tolist(), strict=True)),
            {place: law.get_state() for place, law in self._laws.items()},
            {place: trigger.get_state() for place, trigger in self._endings.items()},
        )

    def set_state(self, state: Any, observation: Observation, replaced: Sequence[int] = ()) -> None:
        """Go on from a state.

        The law in charge begins at it, so that it knows the data, before it is set.

        Args:
            state: The state.
            observation: What the controller sees at it.
            replaced: Phases, by position, whose control laws are of another kind: the state has nothing of them.
        """
        saved = entries(state, self.State, "the phases")
        self.phase_index, self._start_s, self._grasp = saved["phase_index"], saved["start_s"], saved["grasp"]
        self._begun, self._requests = [], []
        self._current = None if saved["current"] is None else PhaseRecord(**saved["current"])
        self._begins_again = saved["begins_again"]
        self._live_index[0] = self.phase_index
        self.telemetry[:] = [saved["telemetry"].get(key, math.nan) for key in self._keys]
        self._asked = {(i, grasp): self.phases[i].law(grasp) for i, grasp in saved["asked"] if i not in replaced}
        in_charge = self.phase_index, self._grasp
        if in_charge in self._asked and observation.attached == self._grasp:  # otherwise another law takes over
            self._asked[in_charge].start(self._seen(observation)._replace(phase_start_s=self._start_s))
        for place, law in self._laws.items():
            if place[0] not in replaced and place in saved["laws"]:
                law.set_state(saved["laws"][place])
        for of_ending, trigger in self._endings.items():
            if of_ending in saved["endings"]:
                trigger.set_state(saved["endings"][of_ending])

    @property
    def in_charge(self) -> str:
        """Name of the phase and kind of its controller, or its part that is being evaluated."""
        phase = self.phases[max(self.phase_index, 0)]
        part = law.in_charge if isinstance(law := phase.law(self._grasp), Parts) else ""
        return f"phase {phase.name!r}, {part}" if part else f"phase {phase.name!r} ({phase.kind})"

    @property
    def law(self) -> Controller:
        """The control law in charge."""
        return self.phases[max(self.phase_index, 0)].law(self._grasp)

    @property
    def grasp(self) -> str:
        """Name of the grasp for whose system the law in charge is made; empty: for the system without a grasp."""
        return self._grasp

    def control(self, observation: Observation, command: Command) -> None:
        """Change phase where it is due, then ask its controller, unless a given command leaves it nothing to command."""
        if self.phase_index < 0:
            self._begin(0, observation, "start")
        ending = self._ended(observation)
        following = self.phase_index + 1 if ending is None or ending.to is None else ending.to
        if ending is not None and following < len(self.phases):
            self._begin(following, observation, ending.reason)
        if observation.attached != self._grasp or self._begins_again:
            self._take_over(observation)
        if self.external is None:
            self._ask(observation, command)
        else:
            if not self.external.is_complete:
                self._ask(observation, command)
            self.external.write(command)
        if self._requests:
            command.requests.update(self._requests)
            self._requests.clear()

    def in_core(self, command: Command, data: Any) -> LawInCore | None:  # noqa: ARG002
        """The law in charge if it is one of the core, and nothing but time or an event can end its phase."""
        return self._in_core(command)

    def _in_core(self, command: Command, before: Callable[[], None] | None = None) -> LawInCore | None:
        """The same for laws of which something updates the data before each evaluation."""
        if self.phase_index < 0 or self._begins_again or self._requests or self.external is not None:
            return None
        phase, places = self.phases[self.phase_index], self._columns[self.phase_index]
        law = phase.law(self._grasp)
        until_s = min((ending.trigger.rests_until_s(self._start_s, law) for ending in phase.endings), default=math.inf)
        if until_s == -math.inf:
            return None
        # Asking for the method is fifty times faster than isinstance of a protocol.
        if not hasattr(law, "law_of_core") or (of_core := cast("OfCore", law).law_of_core()) is None:
            return None
        actuators = np.array(cast("OfCore", law).driven_actuators, dtype=np.intp)
        telemetry = np.arange(len(self.telemetry))[places]
        written = actuators, command.effort, command.powered, telemetry, self.telemetry
        return LawInCore(CommandingLaw(of_core, *written, before), actuators, until_s)

    def _ask(self, observation: Observation, command: Command) -> None:
        """Let the controller of the phase command, and take its telemetry."""
        controller = self.phases[self.phase_index].law(self._grasp)
        controller.control(observation, command)
        if controller.telemetry_signals:
            report = controller.telemetry()
            if len(report) != len(controller.telemetry_signals):
                raise ValueError(f"telemetry gives {len(report)} values for {len(controller.telemetry_signals)} signals")
            self.telemetry[self._columns[self.phase_index]] = report

    def _ended(self, observation: Observation) -> Ending | None:
        """What ends the current phase now; None if nothing does."""
        phase = self.phases[self.phase_index]
        if not phase.endings:
            return None
        free, law = _of_free(observation), phase.law(self._grasp)
        return next((ending for ending in phase.endings if ending.trigger.is_due(free, self._start_s, law)), None)

    def _begin(self, index: int, observation: Observation, reason: str) -> None:
        phase, before = self.phases[index], self.phases[self.phase_index].arm if self.phase_index >= 0 else ()
        self.phase_index = index
        self._requests += [f"{name}.release" for name in phase.release]
        self._requests += [f"{name}.disarm" for name in before if name not in phase.arm]
        self._requests += [f"{name}.arm" for name in phase.arm]
        self._live_index[0], self._start_s = index, observation.time_s
        self.telemetry.fill(np.nan)
        self._current = PhaseRecord(index, phase.name, phase.kind, observation.time_s, reason)
        self._begun.append(self._current)
        for ending in phase.endings:
            ending.trigger.begin(_of_free(observation))
        self._take_over(observation)

    def _take_over(self, observation: Observation) -> None:
        """Let the phase's law for what moves now begin."""
        self._begins_again = False
        self._grasp = observation.attached
        law = self.phases[self.phase_index].law(self._grasp)
        self._asked[self.phase_index, self._grasp] = law
        law.start(observation._replace(phase_start_s=self._start_s))

    def _seen(self, observation: Observation) -> Observation:
        """What the control laws see of the plant: the plant itself."""
        return observation

    def drain_phases(self) -> list[PhaseRecord]:
        """Phases begun since the last call."""
        begun, self._begun = self._begun, []
        return begun

    def tell_phase_again(self) -> None:
        """Let the phase under way be among the phases begun since the last call: a log begins with it."""
        if self._current is not None:
            self._current = replace(self._current, controller=self.phases[self.phase_index].kind)
            self._begun[:] = [self._current]

    def begin_law_again(self, replaced: Sequence[int] = ()) -> None:
        """Let the control law of the phase under way begin at its next call.

        Args:
            replaced: Phases, by position, whose control laws have done nothing yet, though the phases may have begun.
        """
        self._begins_again = True
        for index, grasp in [asked for asked in self._asked if asked[0] in replaced]:
            del self._asked[index, grasp]

    def reports(self) -> dict[str, ControllerReport]:
        """What the control laws of the phases begun say of their work, by phase.

        Raises:
            ControllerError: One says what is neither a finite number nor text.
        """
        reports_by_phase: dict[str, ControllerReport] = {}
        for i in sorted({begun for begun, _ in self._asked}):
            phase = self.phases[i]
            report: dict[str, float | int | str] = {}
            for grasp in ("", *phase.by_grasp):
                law = self._asked.get((i, grasp))
                summary: ControllerReport = law.summary() if isinstance(law, Summarises) else {}
                before = f"{grasp}: " if grasp else ""
                report |= {f"{before}{name}": _plain(phase, name, value) for name, value in summary.items()}
            reports_by_phase[phase.name] = report
        return reports_by_phase


def _of_free(observation: Observation) -> Observation:
    """What the free system would show: its data alone, whatever is held."""
    return observation._replace(data=observation.free) if observation.attached else observation


def _plain(phase: Phase, name: str, value: Any) -> float | int | str:
    """A value of a summary in Python's own types, whatever a law counted in."""
    if isinstance(value, str):
        return str(value)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real) and math.isfinite(value):
        return float(value)
    raise ControllerError(f"summary of phase {phase.name!r} ({phase.kind}): {name} is {value!r}, no finite number or text")
