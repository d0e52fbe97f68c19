"""Output- and state-dependent Riccati equation control of the tip (paper section 3, design section 5).

The reduced dynamics are exact for any momentum; A comes in two parameterizations, because the paper prints one (30) and its
figures were made with the other. ``output_stack`` depends on where the world's origin is, ``velocity`` does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import mujoco
import numpy as np
from pydantic import Field

from ffsm_controllers.osdre.moving_law import MovingLaw
from ffsm_controllers.osdre.riccati import planar_riccati
from ffsm_controllers.osdre.weights import Weight, input_weight, state_weight
from ffsm_mj._core.osdre import BlockLaw, OutputLaw, PlanarLaw, TipKinematics
from ffsm_mj._core.riccati_doubling import Doubling, RiccatiError
from ffsm_mj.arrays import compact
from ffsm_mj.controller_protocol import (
    Command,
    ConstrainedModel,
    ControllerContext,
    ControllerError,
    ControllerReport,
    Damping,
    Fault,
    FloatArray,
    IntArray,
    Observation,
    ScenarioFaults,
    Signal,
    Stateful,
    StrictModel,
    driven_joints,
)
from ffsm_mj.task_model import TaskModel


class OsdreConfig(StrictModel):
    """OSDRE regulation of the task's tip to its target."""

    kind: Literal["osdre"]
    joints: tuple[str, ...] | None = None
    """Joints to drive; left out: every motor-driven joint of the robot but those of the base and of other parts."""
    Q: Weight
    """Weight of the output stack [y; ydot], 2p numbers for a diagonal or 2p rows; its position block must be regular."""
    R: Weight
    """Weight of the torques, positive definite: one number per joint for a diagonal, or rows."""
    parameterization: Literal["output_stack", "velocity"] = "output_stack"
    """Lower block of A: ``output_stack`` d z^+ (the paper's runs), ``velocity`` [0, d ydot^+] (the paper's print)."""
    null_space_damping: Annotated[float, Field(ge=0.0)] = 0.0
    """Damping of motions of a redundant arm that do not move the output, N m s/rad; the output does not feel it."""


_ERROR = Signal("controller", "osdre_error_m", "m", "distance of the output from its target")
_RESIDUAL = Signal("controller", "osdre_riccati_residual", "", "residual of the Riccati equation over its largest term")
_FALLBACK = Signal(
    "controller",
    "osdre_riccati_fallback",
    "",
    "1 where the robust Riccati solver was needed: no warm start, or it failed",
)
_DOUBLINGS = Signal("controller", "osdre_riccati_doublings", "", "doublings that the Riccati equation took")
_CORRECTIONS = Signal(
    "controller", "osdre_riccati_corrections", "", "Newton steps that the Riccati equation took after its doublings"
)
_GAIN = Signal(
    "controller", "osdre_smallest_gain", "", "smallest singular value of alpha M_c^-1: condition 1 holds while > 0"
)


class Osdre(Stateful):
    """OSDRE law. Numbers of the last tick are in ``telemetry``.

    Attributes:
        telemetry_signals: What it reports; how the Riccati equation was solved depends on the number of outputs.
    """

    @dataclass
    class State:
        """Extremes of the Riccati equation so far, (3,), the report of the last tick, and the last solutions."""

        extremes: FloatArray
        report: FloatArray
        riccati: dict[str, Any] | None

    Config = OsdreConfig

    def __init__(self, config: OsdreConfig, context: ControllerContext) -> None:
        """Resolve joints and check the weights.

        Raises:
            ScenarioFaults: No task, an unknown joint, or weights that give no unique stabilising gain.
        """
        if context.task is None:
            raise ScenarioFaults([Fault("osdre needs a 'task' with tip, axes and target", ("kind",))])
        system, self._task = context.system, context.task
        self._model, self._external_field = system.mj, context.external_field
        self._joints = driven_joints(system, config.joints, reserved=context.reserved)
        self._actuators = compact(self._joints.actuators)
        p = len(self._task.axes)
        if p > len(self._joints.dofs):
            raise ScenarioFaults(
                [Fault(f"{p} outputs need at least {p} joints, there are {len(self._joints.dofs)}", ("joints",))]
            )
        Q = state_weight(config.Q, p)
        self._damping = config.null_space_damping
        self._whole_stack = config.parameterization == "output_stack"
        # Products with these pick the driven joints, faster than an index does.
        self._driven = np.eye(self._model.nv)[self._joints.dofs]
        self._inverse_R = np.asarray(np.linalg.inv(input_weight(config.R, len(self._joints.dofs))), dtype=np.float64)
        self._driven_R = self._inverse_R @ self._driven
        self._Q = Q
        # The compiled laws are for trees whose target rests.
        moves = self._task.motion is not None or bool(system.equalities)
        self._moving = TaskModel(context, self._joints.names, ()) if moves else None
        self._planar = p == 2 and not moves
        self.telemetry_signals = (_ERROR, _RESIDUAL, *((_FALLBACK,) if self._planar else (_DOUBLINGS, _CORRECTIONS)), _GAIN)
        # Greatest residual of the Riccati equation, most doublings or 1 for a fallback, sum of corrections or fallbacks
        self._extremes = np.zeros(3)
        self._report = np.full(len(self.telemetry_signals), np.nan)
        self._riccati = planar_riccati(Q) if self._planar else None

    def start_faults(self, data: Any) -> Sequence[Fault]:
        """Joints that depend on each other."""
        return self._moving.start_faults(data) if self._moving is not None else ()

    def start(self, observation: Observation) -> None:
        """Build the law around the plant's data; its Riccati solver starts cold."""
        data, site, axes = observation.data, self._task.tip_site, self._task.axes
        target, driven = self._task.target_m.tolist(), np.vstack((self._driven, self._driven_R))
        kinematics = TipKinematics(self._model, data, site, axes)
        self._law: BlockLaw | MovingLaw | PlanarLaw
        bound = driven, axes, target, self._whole_stack, self._extremes, self._damping, self._external_field
        if self._moving is not None:
            riccati = Doubling(self._Q)
            damping = self._damping * self._driven
            moving = self._inverse_R, self._whole_stack, self._extremes, damping
            self._law = MovingLaw(self._moving, data, riccati, *moving)
        elif self._planar:
            self._riccati = planar_riccati(self._Q)
            self._law = PlanarLaw(kinematics, data, self._riccati, *bound)
        else:
            self._law = BlockLaw(kinematics, data, Doubling(self._Q), *bound)
        self._report = self._law.report

    def control(self, observation: Observation, command: Command) -> None:  # noqa: ARG002
        """Command u = -R^-1 B^T K [y - y_d; ydot], paper (32).

        Raises:
            ControllerError: The Riccati equation has no stabilising solution at this state.
        """
        try:
            self._law.tick()
        except RiccatiError as error:
            raise ControllerError(str(error)) from error
        command.drive(self._actuators, self._law.effort)

    def law_of_core(self) -> OutputLaw[Any] | None:
        """The law, unless its target moves."""
        return self._law if isinstance(self._law, OutputLaw) else None

    @property
    def driven_actuators(self) -> IntArray:
        """Motors of the joints."""
        return self._joints.actuators

    def damping_at(self, data: Any) -> Damping:
        """That of motions which the output does not feel: the rest of the law is on the output alone."""
        jacobian, mobility = np.empty((3, self._model.nv)), np.empty_like(self._driven)
        mujoco.mj_jacSite(self._model, data, jacobian, None, self._task.tip_site)
        ConstrainedModel(self._model).respond(data, self._driven, mobility)
        B_lower = jacobian[list(self._task.axes)] @ mobility.T
        unseen = np.eye(len(self._driven)) - np.linalg.pinv(B_lower) @ B_lower
        return Damping(
            "null_space_damping",
            self._joints.dofs,
            np.full(len(self._driven), self._damping),
            self._damping * unseen,
        )

    def telemetry(self) -> FloatArray:
        """Error, Riccati residual, how it was reached, smallest gain of the last tick."""
        return self._report

    def summary(self) -> ControllerReport:
        """What the Riccati equation took, and its greatest residual, relative."""
        residual, most, exceptions = self._extremes.tolist()
        worst = {"worst_riccati_residual": residual}
        if self._planar:
            return {"riccati_fallbacks": int(exceptions)} | worst
        return {"most_riccati_doublings": int(most), "riccati_corrections": int(exceptions)} | worst
