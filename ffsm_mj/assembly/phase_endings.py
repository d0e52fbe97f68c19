"""Builds what ends a phase, and which phase follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from ffsm_controllers.endings import Ending, EventTrigger, FinishedTrigger, MeasurementBound, TimeTrigger, Trigger
from ffsm_controllers.parts import Parts
from ffsm_controllers.settled import SettlingMonitor
from ffsm_controllers.stop_condition import StopCondition, StopMonitor
from ffsm_mj.controller_protocol import ControllerContext, Finishes
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.records.kinds import kind_named
from ffsm_mj.scenario.phase_config import PhaseConfig, PhaseEnd, SensorEndConfig


def phase_endings(
    config: PhaseConfig,
    names: Sequence[str],
    controller: Any,
    context: ControllerContext,
    grasped: Mapping[str, str] = MappingProxyType({}),
) -> tuple[Ending, ...]:
    """What ends a phase, in the order in which it counts at one instant.

    Args:
        config: Configuration of the phase.
        names: Names of all phases.
        controller: Its control law.
        context: What that is made for in the scene.
        grasped: Object by the name of the grasp that holds it.

    Raises:
        ScenarioFaults: An end that cannot occur; paths in the phase.
    """
    endings = []
    for end in config.ends:
        reason = end.trigger if isinstance(end.trigger, str) else end.trigger.sensor
        to = None if end.to is None else names.index(end.to)
        endings.append(Ending(reason, _trigger(config, end, controller, context, grasped), to))
    return tuple(endings)


def _trigger(
    config: PhaseConfig, end: PhaseEnd, controller: Any, context: ControllerContext, grasped: Mapping[str, str]
) -> Trigger:
    """When an end is due.

    Raises:
        ScenarioFaults: It cannot occur.
    """
    trigger = end.trigger
    if isinstance(trigger, SensorEndConfig):
        return _bound(trigger, end, context)
    if trigger == "time":
        return TimeTrigger(float(config.for_s or 0.0))
    if trigger == "stop_when":
        try:
            return StopMonitor(StopCondition.parse(str(config.stop_when)), context.system, context.task, grasped)
        except ValueError as error:
            raise ScenarioFaults([Fault(str(error), ("stop_when",))]) from error
    if trigger == "settled" and config.settled is not None and context.task is not None:
        return SettlingMonitor(config.settled, context.system, context.task)
    if trigger == "finished":
        _refuse_endless(config, end, controller)
        return FinishedTrigger()
    return EventTrigger(ImpactRecord if trigger == "impact" else kind_named(trigger).record)


def _bound(trigger: SensorEndConfig, end: PhaseEnd, context: ControllerContext) -> MeasurementBound:
    """Bound on a measurement.

    Raises:
        ScenarioFaults: There is no such sensor.
    """
    try:
        name = context.system.resolve("sensor", trigger.sensor)
    except LookupError as error:
        keys = (*end.keys, "sensor") if end.keys == ("until",) else end.keys
        raise ScenarioFaults([Fault(str(error.args[0]), keys)]) from error
    return MeasurementBound(name, trigger.above, trigger.below)


def _refuse_endless(config: PhaseConfig, end: PhaseEnd, controller: Any) -> None:
    """Refuse a phase until its control law has finished where none can finish.

    Raises:
        ScenarioFaults: None can.
    """
    laws = [part.law for part in controller.parts] if isinstance(controller, Parts) else [controller]
    if not any(isinstance(law, Finishes) for law in laws):
        message = f"{config.kind} never finishes; playback and joint_path do, and laws with a method is_finished"
        raise ScenarioFaults([Fault(message, end.keys)])
