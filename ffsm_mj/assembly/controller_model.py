"""Controller models: control laws see the true state, but compute with models that may differ from the plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.phases import Phase, PhaseMachine
from ffsm_mj._core.steppers import WHOLE_STATE
from ffsm_mj.arrays import IntArray
from ffsm_mj.controller_protocol import Command, LawInCore, Observation
from ffsm_mj.model.grasp import WRITTEN
from ffsm_mj.model.system import System, shared_joints


class ControllerModel:
    """A controller model at the true state.

    Attributes:
        model: The model.
        data: MuJoCo data of that model; always the same object.
    """

    def __init__(self, system: System, truth: Any, plant: System, *, grasped: bool = False) -> None:
        """Bind to the model, and copy the state of the plant.

        Args:
            system: System of the controller model, with the actuators of the plant and its joints, or some of them.
            truth: The plant's data.
            plant: The plant's system.
            grasped: Whether it is one with a grasped object.
        """
        self.model, self.data = system.mj, mujoco.MjData(system.mj)
        self._truth, self._shared = plant.mj if grasped else None, shared_joints(system, plant)
        self._has_all = bool(plant.mj.njnt == system.mj.njnt)
        names = [system.mj.joint(j).name for j in range(system.mj.njnt)]
        self._joint_ids: IntArray = np.array([plant.mj.joint(name).id for name in names], dtype=np.intp)
        self.follow(truth)

    def follow(self, truth: Any) -> None:
        """Copy time, coordinates, rates and forces from the plant's data; derived quantities are those of this model."""
        data, (qpos, its_qpos), (dofs, its_dofs) = self.data, *self._shared
        if self._has_all:
            mujoco.mj_copyState(self.model, truth, data, WHOLE_STATE)
        else:
            data.time, data.ctrl[:] = truth.time, truth.ctrl
            data.qpos[qpos], data.qvel[dofs] = truth.qpos[its_qpos], truth.qvel[its_dofs]
            data.qfrc_applied[dofs], data.xfrc_applied[:] = truth.qfrc_applied[its_dofs], truth.xfrc_applied
        self.update()

    def update(self) -> None:
        """Update derived quantities for the state in ``data``."""
        if self._truth is not None:  # the pose of a grasped object is written as the grasp closes
            for field in WRITTEN:
                values = getattr(self._truth, field)
                getattr(self.model, field)[:] = values[self._joint_ids] if field.startswith("jnt_") else values
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
        super().control(self._seen(observation), command)

    def _seen(self, observation: Observation) -> Observation:
        """What the control laws see: the models at the state of the plant."""
        self._model.follow(observation.free)
        current = self._model
        if attached := observation.attached:
            current = self._grasped[attached]
            current.follow(observation.data)
        # NamedTuple._replace would take twice as long, at every tick.
        return Observation(
            observation.time_s,
            current.data,
            observation.events,
            observation.at_tick,
            observation.contacts,
            self._model.data,
            observation.grasps,
            observation.measured,
        )

    def in_core(self, command: Command, data: Any) -> LawInCore | None:
        """See :class:`PhaseMachine`; the model follows the plant before each evaluation. None while an object is grasped."""
        return None if self.grasp else self._in_core(command, partial(self._model.follow, data))
