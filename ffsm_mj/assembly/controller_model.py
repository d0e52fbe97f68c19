"""Control laws that take the models for other ones: the state that they see is true, what they make of it need not be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
from ffsm_controllers.phases import Phase, PhaseMachine

from ffsm_mj.controller_protocol import Command, Observation
from ffsm_mj.dynamics.free_stepper import WHOLE_STATE


class ControllerModel:
    """A model that is believed in, at the true state.

    Attributes:
        data: MuJoCo data of that model, the same object for good.
    """

    def __init__(self, model: Any, truth: Any, held: Any = None) -> None:
        """Take over the state in the plant's data.

        Args:
            model: The model that is believed in, with the degrees of freedom and the actuators of the true one.
            truth: The plant's data.
            held: The true model, where it is one in which an object is held.
        """
        self._model, self.data, self._truth = model, mujoco.MjData(model), held
        self.follow(truth)

    def follow(self, truth: Any) -> None:
        """Take over time, coordinates, rates and forces in the plant's data; all that derives from them is this model's."""
        mujoco.mj_copyState(self._model, truth, self.data, WHOLE_STATE)
        if self._truth is not None:  # where an object is held is written at its capture
            self._model.body_pos[:], self._model.body_quat[:] = self._truth.body_pos, self._truth.body_quat
        mujoco.mj_forward(self._model, self.data)


class ControllerModelPhaseMachine(PhaseMachine):
    """The phase machine, all of whose control laws see the data of a model that they believe in."""

    def __init__(self, phases: Sequence[Phase], belief: ControllerModel, held: Mapping[str, ControllerModel]) -> None:
        """Know the laws, made for the models that are believed in, and their data.

        Args:
            phases: The phases with these laws.
            belief: In the scene as it begins.
            held: In the systems in which an object is held, by the name of the capture.
        """
        super().__init__(phases)
        self._belief, self._held = belief, held

    def control(self, observation: Observation, command: Command) -> None:
        """Change phase where it is due, then ask its controller."""
        self._belief.follow(observation.free)
        seen = self._belief
        if observation.grasp:
            seen = self._held[observation.grasp]
            seen.follow(observation.data)
        told, free = observation, self._belief.data
        # Made anew: NamedTuple._replace takes twice as long, at every tick.
        shown = Observation(told.time_s, seen.data, told.events, told.at_tick, told.contacts, free, told.grasp)
        super().control(shown, command)
