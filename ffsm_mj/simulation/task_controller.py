"""What the simulation asks of the controller of a whole run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from ffsm_mj.controller_protocol import LawInCore, Observation
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.command import Command, GivenCommand
from ffsm_mj.records.events import ControllerReport, PhaseRecord


class TaskController(Protocol):
    """The controller of a whole run: the phase machine."""

    columns: tuple[Columns, ...]
    """Reports of the phases' controllers after the last call, NaN in the columns of other phases; the phase's position."""

    given: GivenCommand | None
    """Command of the program that steps the simulation; None: the controllers of the phases command everything."""

    @property
    def in_charge(self) -> str:
        """Who decides now, for a person: phase and kind of controller."""

    def control(self, observation: Observation, command: Command) -> None:
        """Like :meth:`~ffsm_mj.controller_protocol.Controller.control`."""

    @property
    def grasp(self) -> str:
        """Name of the grasp for whose system the law in charge is made; empty: for the system without a grasp."""

    def in_core(self, command: Command, data: Any) -> LawInCore | None:
        """The law in charge, to be evaluated by the core at control ticks without events; None if it cannot be.

        Args:
            command: What it commands.
            data: Data of the plant.
        """

    def drain_phases(self) -> list[PhaseRecord]:
        """Phases begun since the last call, oldest first."""

    def tell_phase_again(self) -> None:
        """Let the phase under way be among the phases begun since the last call: a log begins with it."""

    def begin_law_again(self, replaced: Sequence[int] = ()) -> None:
        """Let the control law of the phase under way begin at its next call.

        Args:
            replaced: Phases, by position, whose control laws have done nothing yet, though the phases may have begun.
        """

    def get_state(self) -> Any:
        """What phases and control laws remember."""

    def set_state(self, state: Any, observation: Observation, replaced: Sequence[int] = ()) -> None:
        """Go on from a state.

        Args:
            state: The state.
            observation: What the controller sees at it.
            replaced: Phases, by position, whose control laws are of another kind: the state has nothing of them.
        """

    def reports(self) -> Mapping[str, ControllerReport]:
        """What the control laws of the phases begun say of their work, by phase."""
