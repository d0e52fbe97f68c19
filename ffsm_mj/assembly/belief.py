"""Control laws that take the models for other ones: the state that they see is true, what they make of it need not be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from ffsm_controllers.phases import Phase, PhaseMachine

from ffsm_mj.controller_protocol import Command, Observation
from ffsm_mj.motion.flight import WHOLE_STATE


class Belief:
    """A model that is believed in, at the true state.

    Attributes:
        data: MuJoCo data of that model, the same object for good.
    """

    def __init__(self, model: Any, truth: Any) -> None:
        """Take over the state in the plant's data.

        Args:
            model: The model that is believed in, with the degrees of freedom and the actuators of the true one.
            truth: The plant's data.
        """
        self._model, self.data = model, mujoco.MjData(model)
        self._state = np.empty(mujoco.mj_stateSize(model, WHOLE_STATE))
        self.follow(truth)

    def follow(self, truth: Any) -> None:
        """Take over time, coordinates, rates and forces in the plant's data; all that derives from them is this model's."""
        mujoco.mj_getState(self._model, truth, self._state, WHOLE_STATE)
        mujoco.mj_setState(self._model, self.data, self._state, WHOLE_STATE)
        mujoco.mj_forward(self._model, self.data)


class BelievingMachine(PhaseMachine):
    """The phase machine, all of whose control laws see the data of a model that they believe in."""

    def __init__(self, phases: Sequence[Phase], belief: Belief) -> None:
        """Know the laws, made for the model that is believed in, and its data."""
        super().__init__(phases)
        self._belief = belief

    def control(self, observation: Observation, command: Command) -> None:
        """Change phase where it is due, then ask its controller."""
        self._belief.follow(observation.data)
        super().control(observation._replace(data=self._belief.data), command)
