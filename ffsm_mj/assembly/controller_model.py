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


class SharedJoints:
    """Where the joints of a model are in another one that has them all, by name.

    Attributes:
        ids: Ids of the joints in the other model, (njnt,).
        qpos: Indices of the coordinates in it, (nq,).
        dofs: Indices of the degrees of freedom in it, (nv,).
        all: Whether it has no other joints.
    """

    def __init__(self, other: Any, model: Any) -> None:
        """Find the joints of ``model`` in ``other``."""
        self.ids: IntArray = np.array([other.joint(model.joint(j).name).id for j in range(model.njnt)], dtype=np.intp)
        joints = [(other.joint(int(j)), model.joint(k)) for k, j in enumerate(self.ids)]
        self.qpos: IntArray = np.concatenate([there.qposadr[0] + np.arange(len(own.qpos0)) for there, own in joints])
        self.dofs: IntArray = np.concatenate([there.dofadr[0] + np.arange(len(own.damping)) for there, own in joints])
        self.all = bool(other.njnt == model.njnt)


class ControllerModel:
    """A controller model at the true state.

    Attributes:
        model: The model.
        data: MuJoCo data of that model; always the same object.
    """

    def __init__(self, model: Any, truth: Any, plant: Any, *, grasped: bool = False) -> None:
        """Bind to the model, and copy the state of the plant.

        Args:
            model: The controller model, with the actuators of the plant and its joints, or some of them.
            truth: The plant's data.
            plant: The plant's model.
            grasped: Whether the plant's model is one with a grasped object.
        """
        self.model, self.data = model, mujoco.MjData(model)
        self._truth, self._joints = plant if grasped else None, SharedJoints(plant, model)
        self.follow(truth)

    def follow(self, truth: Any) -> None:
        """Copy time, coordinates, rates and forces from the plant's data; derived quantities are those of this model."""
        data, joints = self.data, self._joints
        if joints.all:
            mujoco.mj_copyState(self.model, truth, data, WHOLE_STATE)
        else:
            data.time, data.ctrl[:] = truth.time, truth.ctrl
            data.qpos[:], data.qvel[:] = truth.qpos[joints.qpos], truth.qvel[joints.dofs]
            data.qfrc_applied[:], data.xfrc_applied[:] = truth.qfrc_applied[joints.dofs], truth.xfrc_applied
        self.update()

    def update(self) -> None:
        """Update derived quantities for the state in ``data``."""
        if self._truth is not None:  # the pose of a grasped object is written as the grasp closes
            for field in WRITTEN:
                values = getattr(self._truth, field)
                getattr(self.model, field)[:] = values[self._joints.ids] if field.startswith("jnt_") else values
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
