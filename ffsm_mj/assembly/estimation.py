"""Estimates in place of the true state: what control laws see with an estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import mujoco
import numpy as np

from ffsm_controllers.estimators import estimators
from ffsm_controllers.phases import Phase, PhaseMachine
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.control_laws import plugin_errors, signals_fault
from ffsm_mj.assembly.controller_model import ControllerModel
from ffsm_mj.contact_models.grasp.latch_joints import LatchJoints
from ffsm_mj.controller_protocol import Command, ControllerContext, ControllerError, Estimator, LawInCore, Observation
from ffsm_mj.dynamics.rigid_body import rotation_dofs
from ffsm_mj.errors import Fault, ScenarioFaults, described, raised_at
from ffsm_mj.model.system import System, shared_joints
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.signals import Signal, coordinate_keys, rate_keys, unit_of
from ffsm_mj.state import entries, fitting
from ffsm_mj.unchanging import with_state

_MEASURED = ("event", "time_s", "step", "pair", "geoms", "joint", "rule", "grasp")
"""Fields of an event record that are reported to a robot."""


class EstimatePhaseMachine(PhaseMachine):
    """Phase machine whose control laws see an estimate of the state: ``data`` and ``free`` are those of the estimate."""

    def __init__(
        self,
        phases: Sequence[Phase],
        estimator: Estimator,
        kind: str,
        system: System,
        model: ControllerModel,
        grasped: Mapping[str, tuple[System, ControllerModel]],
    ) -> None:
        """Bind estimator and control laws to their models.

        Args:
            phases: The phases, with control laws constructed for these models.
            estimator: The estimator.
            kind: Its kind.
            system: The system of the controller model.
            model: Controller model of the scene without a grasp; its data hold the initial state.
            grasped: The same with a grasped object, by the name of the grasp.
        """
        super().__init__(phases)
        self._estimator, self._kind, self._model, self._started = estimator, kind, model, False
        self._stateful = with_state(estimator, f"the estimator {kind!r}")
        self._grasped = {
            name: _GraspedEstimate(system, grasped_system, its) for name, (grasped_system, its) in grasped.items()
        }
        self._columns_of_estimate = EstimateColumns(system)
        reports = tuple(estimator.telemetry_signals)
        self._reports = np.full(len(reports), np.nan)
        self.columns = (
            *self.columns,
            Columns(self._columns_of_estimate.signals, live=self._columns_of_estimate.values),
            *([Columns(reports, live=self._reports)] if reports else []),
        )

    def get_state(self) -> Any:
        """What the phases remember, and the estimate."""
        data = self._model.data
        return {
            "phases": super().get_state(),
            "started": self._started,
            "estimator": self._stateful.get_state(),
            "estimate": (data.qpos.copy(), data.qvel.copy(), float(data.time)),
            "columns": (self._reports.copy(), self._columns_of_estimate.values.copy()),
        }

    def set_state(self, state: Any, observation: Observation, replaced: Sequence[int] = ()) -> None:
        """Go on from a state; estimator and law in charge begin at it before they are set."""
        kept = entries(state, ("phases", "started", "estimator", "estimate", "columns"), "the estimate")
        data, (qpos, qvel, time_s) = self._model.data, kept["estimate"]
        data.qpos[:] = fitting(qpos, data.qpos.shape, "the estimate")
        data.qvel[:] = fitting(qvel, data.qvel.shape, "the estimate")
        data.ctrl[:], data.time = observation.free.ctrl, time_s
        self._model.update()
        self._started = kept["started"]
        if self._started:
            self._estimator.start(data)
        self._stateful.set_state(kept["estimator"])
        super().set_state(kept["phases"], observation, replaced)
        for columns, values in zip((self._reports, self._columns_of_estimate.values), kept["columns"], strict=True):
            columns[:] = fitting(values, columns.shape, "columns of the estimate")

    def control(self, observation: Observation, command: Command) -> None:
        """Update the estimate, change the phase if it has ended, then evaluate its control law."""
        self._update(observation)
        super().control(self._seen(observation), command)

    def _seen(self, observation: Observation) -> Observation:
        """What the control laws see, with the columns of the error."""
        free = self._model.data
        attached = observation.attached
        data = self._grasped[attached].show(self._model) if attached else free
        self._columns_of_estimate.compare(free, observation.free)
        events = tuple(without_solution(event) for event in observation.events)
        measured = observation.measured
        return Observation(observation.time_s, data, events, observation.at_tick, (), free, observation.grasps, measured)

    def in_core(self, command: Command, data: Any) -> LawInCore | None:  # noqa: ARG002
        """None: the estimator is evaluated at every tick."""
        return None

    def _update(self, observation: Observation) -> None:
        """Let the estimator write its estimate, and update derived quantities.

        Raises:
            ControllerError: The estimator fails, its estimate is not finite, or its telemetry has another length.
        """
        data = self._model.data
        data.ctrl[:] = observation.free.ctrl
        try:
            report = self._estimated(observation, data)
        except Exception as error:  # an estimator's code: it has failed, not the control law of the phase
            raise ControllerError(f"estimator {self._kind!r}: {described(error)}{raised_at(error)}") from error
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            raise ControllerError(f"estimator {self._kind!r} gives an estimate that is not finite")
        data.time = observation.time_s
        self._model.update()
        if len(report) != len(self._reports):
            raise ControllerError(
                f"estimator {self._kind!r}: telemetry gives {len(report)} values for {len(self._reports)} signals"
            )
        self._reports[:] = report

    def _estimated(self, observation: Observation, data: Any) -> FloatArray:
        """Let the estimator write its estimate; returns its telemetry."""
        if not self._started:
            self._started = True
            self._estimator.start(data)
        events = tuple(without_solution(event) for event in observation.events)
        self._estimator.update(observation.time_s, observation.measured, events, data)
        if not len(self._reports):
            return self._reports
        return np.atleast_1d(np.array(self._estimator.telemetry(), dtype=np.float64))


class _GraspedEstimate:
    """The estimate in the model with a grasped object."""

    def __init__(self, system: System, grasped: System, model: ControllerModel) -> None:
        self._model = model
        self._qpos, self._dofs = shared_joints(system, grasped)
        assert grasped.grasp is not None
        self._latch = LatchJoints(system, grasped, grasped.grasp)
        tree = next(tree for tree in system.trees if tree.name == grasped.grasp.tree)
        self._joint, self._object = tree.joints[0], grasped.mj.body(system.mj.body(tree.root).name).id
        self._scratch = np.zeros(6)

    def show(self, free: ControllerModel) -> Any:
        """Data of the grasped model at the estimate; the object's own joint in the free estimate follows the hand."""
        data, scene = self._model.data, free.data
        (ours, theirs), (our_rates, their_rates) = self._qpos, self._dofs
        data.qpos[theirs], data.qvel[their_rates] = scene.qpos[ours], scene.qvel[our_rates]
        self._latch.write_coordinates(scene, data.qpos)
        data.qvel[self._latch.dofs] = self._latch.rate_rows(scene) @ scene.qvel
        data.ctrl[:], data.time = scene.ctrl, scene.time
        self._model.update()
        if self._joint.kind == "free":
            body = self._object
            mujoco.mj_objectVelocity(self._model.model, data, mujoco.mjtObj.mjOBJ_XBODY, body, self._scratch, 0)
            turning = data.xmat[body].reshape(3, 3).T @ self._scratch[:3]
            scene.qpos[self._joint.qpos] = np.concatenate((data.xpos[body], data.xquat[body]))
            scene.qvel[self._joint.dofs] = np.concatenate((self._scratch[3:], turning))
            free.update()
        return data


class EstimateColumns:
    """Columns of the estimate and of its error.

    Attributes:
        signals: Their signals.
        values: Estimated coordinates and rates, errors of the coordinates (rotations as vectors in body axes) and of the
            rates, (nq + 3 nv,).
    """

    def __init__(self, system: System) -> None:
        """Name the columns as those of the state."""
        self._model = system.mj
        joints = tuple(system.joints.values())
        coordinates = [key.removeprefix("state.") for key in coordinate_keys(joints)]
        rates = [key.removeprefix("state.") for key in rate_keys(joints)]
        turning = {i for part in rotation_dofs(system.mj) for i in range(part.start, part.stop)}
        errors = [_error_name(rate, i in turning) for i, rate in enumerate(rates)]
        self.signals = (
            *(Signal("estimate", name, unit_of(name), f"estimate of state.{name}") for name in (*coordinates, *rates)),
            *(Signal("estimate", name, unit_of(name), "estimate less truth, of the coordinate") for name in errors),
            *(Signal("estimate", f"error_{name}", unit_of(name), f"estimate less truth of state.{name}") for name in rates),
        )
        self.values = np.full(len(self.signals), np.nan)

    def compare(self, estimate: Any, truth: Any) -> None:
        """Take the estimate and its error."""
        model, apart = self._model, np.empty(self._model.nv)
        mujoco.mj_differentiatePos(model, apart, 1.0, truth.qpos, estimate.qpos)
        self.values[:] = np.concatenate((estimate.qpos, estimate.qvel, apart, estimate.qvel - truth.qvel))


def _error_name(rate: str, turns: bool) -> str:
    """Name of the error of the coordinate of a rate: ``v_box_vx_m_s`` gives ``error_q_box_x_m``."""
    for of_rate, of_coordinate in (("rad_s", "rad"), ("m_s", "m")):
        if rate.endswith(of_rate):
            stem = rate.removeprefix("v_").removesuffix(of_rate)
            for axis in "xyz":
                letter = "w" if turns else "v"
                if stem.endswith(f"_{letter}{axis}_"):
                    stem = f"{stem[:-3]}{'turn_' if turns else ''}{axis}_"
            return f"error_q_{stem}{of_coordinate}"
    raise ValueError(rate)


def without_solution(record: Any) -> Any:
    """What is reported of an event to a robot: its class, time and pair; other numbers are NaN, other fields empty."""
    if not isinstance(record, ImpactRecord):
        return record
    hidden: dict[str, Any] = {}
    for field in fields(record):
        value = getattr(record, field.name)
        if field.name not in _MEASURED:
            hidden[field.name] = np.nan if isinstance(value, float) else type(value)()
    return replace(record, **hidden)


def make_estimator(config: Any, context: ControllerContext, classes: Mapping[str, Any]) -> Estimator:
    """The estimator of a scenario; ``own`` are those of a script, classes by kind.

    Raises:
        ScenarioFaults: It cannot be made; paths in the scenario.
    """
    known = estimators()
    if reason := known.broken.get(config.kind):
        message = f"the plugin for kind {config.kind!r} cannot be used ({reason})"
        raise ScenarioFaults([Fault(message, ("estimator", "kind"))])
    with plugin_errors("estimator", "estimator"):
        estimator: Estimator = (classes.get(config.kind) or known.classes[config.kind])(config, context)
    if fault := signals_fault(estimator.telemetry_signals, "estimate") or _reserved(
        estimator.telemetry_signals, context.system
    ):
        raise ScenarioFaults([Fault(f"telemetry of kind {config.kind!r}: {fault}", ("estimator", "kind"))])
    return estimator


def _reserved(signals: Sequence[Signal], system: System) -> str:
    """Which of these signals has the name of a column that every estimate has; empty if none has."""
    reserved = {signal.key for signal in EstimateColumns(system).signals}
    return next((f"{signal.key} is a column of the estimate itself" for signal in signals if signal.key in reserved), "")
