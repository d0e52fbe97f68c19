"""The resolved scenario for run folder and log: with all defaults, and the paths of the stored files."""

from __future__ import annotations

from typing import Any

from ffsm_mj.assembly.recorded_files import RecordedFiles
from ffsm_mj.log.run_folder import BEFORE
from ffsm_mj.model.files import logged_name, stored_with
from ffsm_mj.model.system import System
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.yaml import write_yaml


def resolved_yaml(scenario: ScenarioConfig, system: System, recorded: RecordedFiles) -> str:
    """YAML of a scenario that runs again from a run folder."""
    return write_yaml(resolved_data(scenario, system, recorded))


def resolved_data(scenario: ScenarioConfig, system: System, recorded: RecordedFiles) -> dict[str, Any]:
    """The same as plain data."""
    data = scenario.model_dump(mode="json", by_alias=True)
    if scenario.initial.from_ is not None:
        data["initial"]["from"] = BEFORE
    for name, files in system.files.items():
        part = data["robot"] if name == "robot" else data["objects"][name]
        stored = stored_with(name, system.files)
        part["mjcf"] = logged_name(stored, files.main)
        part["asset_folders"] = [] if files.beside else [logged_name(stored, "")]
        part["package_paths"] = []  # files of packages are stored beside the model
    for (*keys, last), name in recorded.names.items():
        section: Any = data
        for key in keys:
            section = section[key]
        section[last] = name
    without: dict[str, Any] = _without_none(data)
    return without


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return value if not isinstance(value, list) else [_without_none(item) for item in value]
