"""Models, pairs and limits of a run, rebuilt from its log by the functions that built them for the run."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import ValidationError

from ffsm_mj.assembly.contact_rules import resolve_contacts
from ffsm_mj.assembly.control_laws import task_of
from ffsm_mj.assembly.grasps import grasped_systems_of
from ffsm_mj.assembly.initial_state import initial_state
from ffsm_mj.assembly.joint_limits import joint_limits
from ffsm_mj.assembly.plant import build_plant, environment_metadata
from ffsm_mj.errors import InputError, ScenarioFaults
from ffsm_mj.log.scenario import compile_log, scenario_data
from ffsm_mj.records.metadata import conservative_metadata, free_metadata, gravity_metadata
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.scenario.loading import with_plugins
from ffsm_mj.scenario.scenario import UNUSABLE_LAW, ScenarioConfig, timing_faults
from ffsm_mj.simulation.plant import Plant

_NO_CONTROL = {
    "phases": [{"name": "any", "until": "end", "controller": {"kind": "off"}}],
    "controller_model": {},
    "controller_joints": "flexible",
    "estimator": {"kind": "truth"},
}
"""Control laws and estimators need not be installed where a log is analysed."""


@dataclass(frozen=True)
class LogScene:
    """Scenario and plant of a run without its control laws; see :class:`ffsm_mj.assembly.assemble.Assembly`."""

    scenario: ScenarioConfig
    plant: Plant


def log_scene(log: RunLog) -> LogScene:
    """Build the models, contact pairs and limits of a run; its control laws need not be installed.

    Raises:
        InputError: The log has no scenario or no models, or they are inconsistent.
    """
    scenario = _scenario(log)
    system = compile_log(log)
    try:
        # At the start of the run, as the division of steps follows from the rates of servos there.
        data = initial_state(scenario, system).data
        pairs, limits = resolve_contacts(scenario.contacts, system).pairs, joint_limits(scenario, system)
        # The models are those in the log, not files that may have changed since.
        grasped = grasped_systems_of(scenario, system, lambda grasp, _: compile_log(log, grasp=grasp))
        return LogScene(scenario, build_plant(scenario, system, data, pairs, limits, grasped, task_of(scenario, system)))
    except ScenarioFaults as error:
        raise InputError([f"{'.'.join(map(str, fault.path))}: {fault.message}" for fault in error.faults]) from error


def _scenario(log: RunLog) -> ScenarioConfig:
    """The scenario without its control laws.

    Raises:
        InputError: It does not match the schema of this version.
    """
    try:
        scenario = with_plugins(ScenarioConfig.model_validate(scenario_data(log) | _NO_CONTROL))
    except ValidationError as error:
        for item in error.errors():
            # Control laws are not needed, an impact law is: impacts are resolved again by it.
            if item["type"] == UNUSABLE_LAW:
                raise InputError(f"the impact law {item['input']!r} of the log is not installed") from error
        keys = ", ".join(sorted({".".join(map(str, fault["loc"])) for fault in error.errors()}))
        raise InputError(f"the scenario in the log is not of this version ({keys})") from error
    except ScenarioFaults as error:
        raise InputError([f"the scenario in the log: {fault.message}" for fault in error.faults]) from error
    # Steps that do not divide the control period, or none at all, would have no grid to replay on.
    for fault in timing_faults(scenario):
        raise InputError(f"the scenario in the log: {'.'.join(map(str, fault.path))} {fault.message}")
    return scenario


def state_metadata(scene: LogScene) -> dict[str, str]:
    """Metadata of a run derived from its models."""
    system = scene.plant.system
    metadata = free_metadata(scene.plant.balance.free) | conservative_metadata(system.faults)
    metadata |= gravity_metadata(system.mj.opt.gravity) | environment_metadata(scene.scenario)
    return metadata | {"time_step_s": repr(scene.scenario.time_step_s)}
