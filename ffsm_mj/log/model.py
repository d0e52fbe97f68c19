"""The models of a run from its log alone, compiled again in memory."""

from __future__ import annotations

from dataclasses import replace

from ffsm_mj.errors import THE_LOG, InputError, ScenarioFaults
from ffsm_mj.log.scenario import logged_scenario
from ffsm_mj.model.files import ModelFiles, logged_model, logged_name
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System, compile_system
from ffsm_mj.records.run_log import RunLog


def compile_log(log: RunLog, place: str = THE_LOG, grasp: Grasp | None = None) -> System:
    """Compile what the log carries, by what a run compiles with; control laws of others need not be installed for that.

    Nothing is written, and nothing but the log is read: a model of the log that refers to another file is refused.

    Args:
        log: The log.
        place: Its name for messages.
        grasp: Let an object be held; None: the scene as it begins.

    Raises:
        InputError: The log carries no scenario, or a model that is not whole or does not compile any more.
    """
    scenario = logged_scenario(log, place)

    def carried(name: str, main: str) -> ModelFiles:
        prefix = logged_name(name, "")
        if not main.startswith(prefix):
            raise InputError(f"{place}: the model of {name} is {main!r}, not a file below {prefix}")
        files = {key.removeprefix(prefix): content for key, content in log.header.files.items() if key.startswith(prefix)}
        model = logged_model(main.removeprefix(prefix), files, f"{place}: {prefix}")
        changed = (scenario.overrides[name],) if scenario.overrides.get(name) else ()
        return replace(model, strip=scenario.strip[name], overrides=changed, pose=scenario.poses.get(name))

    try:
        return compile_system(
            replace(carried("robot", scenario.robot), sites=scenario.sites),
            {name: carried(name, main) for name, main in scenario.objects.items()},
            time_step_s=scenario.time_step_s,
            conservative=scenario.conservative,
            grasp=grasp,
        )
    except ScenarioFaults as unplaced:
        raise InputError([f"{place}: {fault.message}" for fault in unplaced.faults]) from unplaced
