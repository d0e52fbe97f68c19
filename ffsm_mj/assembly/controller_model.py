"""Controller models: control laws see the true state, but compute with models that may differ from the plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
from ffsm_controllers.phases import Phase, PhaseMachine

from ffsm_mj.controller_protocol import Command, Observation
from ffsm_mj.dynamics.free_stepper import WHOLE_STATE
from ffsm_mj.model.grasp import WRITTEN


class ControllerModel:
    """A controller model at the true state.

    Attributes:
        model: The model.
        data: MuJoCo data of that model; always the same object.
    """

    def __init__(self, model: Any, truth: Any, grasped: Any = None) -> None:
        """Bind to the model, and copy the state of the plant.

        Args:
            model: The controller model, with the degrees of freedom and the actuators of the plant.
            truth: The plant's data.
            grasped: Model of the plant with a grasped object, if there is one.
        """
        self.model, self.data, self._truth = model, mujoco.MjData(model), grasped
        self.follow(truth)

    def follow(self, truth: Any) -> None:
        """Copy time, coordinates, rates and forces from the plant's data; derived quantities are those of this model."""
        mujoco.mj_copyState(self.model, truth, self.data, WHOLE_STATE)
        self.update()

    def update(self) -> None:
        """Update derived quantities for the state in ``data``."""
        if self._truth is not None:  # the pose of a grasped object is written as the grasp closes
            for field in WRITTEN:
                getattr(self.model, field)[:] = getattr(self._truth, field)
        mujoco.mj_forward(self.model, self.data)


class ControllerModelPhaseMachine(PhaseMachine):
    """Phase machine whose control laws see the data of a controller model."""

    def __init__(
        self, phases: Sequence[Phase], controller_model: ControllerModel, grasped: Mapping[str, ControllerModel]
    ) -> None:
        """Bind the control laws to their models.

        Args:
            phases: The phases, with control laws constructed for these models.
            controller_model: Controller model of the scene without a grasp.
            grasped: Controller models with a grasped object, by the name of the grasp.
        """
        super().__init__(phases)
        self._model, self._grasped = controller_model, grasped

    def control(self, observation: Observation, command: Command) -> None:
        """Change the phase if it has ended, then evaluate its control law."""
        self._model.follow(observation.free)
        current = self._model
        if observation.grasp:
            current = self._grasped[observation.grasp]
            current.follow(observation.data)
        # NamedTuple._replace would take twice as long, at every tick.
        of_model = Observation(
            observation.time_s,
            current.data,
            observation.events,
            observation.at_tick,
            observation.contacts,
            self._model.data,
            observation.grasp,
            observation.measured,
        )
        super().control(of_model, command)
