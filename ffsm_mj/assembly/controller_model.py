"""Controller models: control laws see the true state, but compute with models that may differ from the plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
from ffsm_controllers.phases import Phase, PhaseMachine

from ffsm_mj.controller_protocol import Command, Observation
from ffsm_mj.dynamics.free_stepper import WHOLE_STATE


class ControllerModel:
    """A controller model at the true state.

    Attributes:
        data: MuJoCo data of that model; always the same object.
    """

    def __init__(self, model: Any, truth: Any, held: Any = None) -> None:
        """Bind to the model, and copy the state of the plant.

        Args:
            model: The controller model, with the degrees of freedom and the actuators of the plant.
            truth: The plant's data.
            held: Model of the plant with a grasped object, if there is one.
        """
        self._model, self.data, self._truth = model, mujoco.MjData(model), held
        self.follow(truth)

    def follow(self, truth: Any) -> None:
        """Copy time, coordinates, rates and forces from the plant's data; derived quantities are those of this model."""
        mujoco.mj_copyState(self._model, truth, self.data, WHOLE_STATE)
        if self._truth is not None:  # where an object is held is written at its capture
            self._model.body_pos[:], self._model.body_quat[:] = self._truth.body_pos, self._truth.body_quat
        mujoco.mj_forward(self._model, self.data)


class ControllerModelPhaseMachine(PhaseMachine):
    """Phase machine whose control laws see the data of a controller model."""

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
        """Change the phase if it has ended, then evaluate its control law."""
        self._belief.follow(observation.free)
        seen = self._belief
        if observation.grasp:
            seen = self._held[observation.grasp]
            seen.follow(observation.data)
        told, free = observation, self._belief.data
        # NamedTuple._replace would take twice as long, at every tick.
        shown = Observation(told.time_s, seen.data, told.events, told.at_tick, told.contacts, free, told.grasp)
        super().control(shown, command)
