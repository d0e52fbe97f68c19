"""The file of a unit: a scenario with its models, the class that runs it, and binaries of PythonFMU that load this class."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from contextlib import closing
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from uuid import NAMESPACE_URL, uuid5

from ffsm_mj.assembly.prepare import Scenario
from ffsm_mj.assembly.run import versions
from ffsm_mj.errors import InputError, MissingPackageError
from ffsm_mj.fmu.co_simulation import CoSimulation

SCENARIO, ABOUT = "scenario", "unit.json"
"""Folder of the scenario and file with what is known of it, among the resources of a unit."""
_SLAVE = Path(__file__).with_name("ffsm_slave.py")


def write_unit(scenario: Scenario, file: Path) -> CoSimulation:
    """Write a scenario as a unit.

    Args:
        scenario: The scenario.
        file: The file; one that exists is replaced.

    Returns:
        The scenario as the unit has it, with its variables.

    Raises:
        InputError: The scenario is wrong, or the file cannot be written.
        MissingPackageError: PythonFMU is not installed.
    """
    try:
        from pythonfmu import FmuBuilder
    except ImportError as error:
        raise MissingPackageError("ffsm fmu", "pythonfmu", "fmu") from error
    with TemporaryDirectory(prefix="ffsm_fmu_") as temporary:
        folder = Path(temporary)
        scenario.to_yaml(folder / SCENARIO)
        with closing(CoSimulation(folder / SCENARIO)) as unit:
            about = json.dumps(_about(scenario, unit.time_s, folder), indent=2)
        (folder / ABOUT).write_text(about + "\n", encoding="utf-8")
        whole = folder / "whole.fmu"
        FmuBuilder.build_FMU(_SLAVE, whole, [folder / SCENARIO, folder / ABOUT])
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            unfinished = file.with_name(f".{file.name}-{os.getpid()}")
            unfinished.write_bytes(whole.read_bytes())
            os.replace(unfinished, file)
        except OSError as error:
            raise InputError(f"{file}: cannot be written ({error.strerror})") from error
    return unit


def _about(scenario: Scenario, start_s: float, folder: Path) -> dict[str, Any]:
    """What a unit says of itself; ``start_s`` is not 0 where the scenario goes on from another run."""
    config, files = scenario.prepared.scenario, _digests(folder / SCENARIO)
    name = re.sub(r"\W", "_", config.name)
    return {
        "name": name if name[0].isalpha() else f"_{name}",
        "description": config.description,
        "version": versions()["ffsm-mj"],
        "start_s": start_s,
        "stop_s": config.duration_s,
        "period_s": config.control_period_s,
        "guid": _guid(files),
        "files": files,
    }


def _guid(files: Mapping[str, str]) -> str:
    """Identifier by which a master knows that description and binaries belong together: that of the files."""
    return f"{{{uuid5(NAMESPACE_URL, json.dumps(dict(files)))}}}"


def _digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file in a folder, by its relative path."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): sha256(path.read_bytes()).hexdigest() for path in files}


def check_resources(folder: Path) -> dict[str, Any]:
    """What a unit says of itself.

    Args:
        folder: Its resources.

    Raises:
        InputError: A file of the scenario is not the one that was exported.
    """
    about: dict[str, Any] = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
    present, stated = _digests(folder / SCENARIO), about["files"]
    if odd := sorted(dict(present.items() ^ stated.items())):
        raise InputError(
            f"{SCENARIO}/{odd[0]} of the unit {about['name']} was changed after its export; change the scenario and "
            "export it again, or set a parameter of the unit"
        )
    if about["guid"] != _guid(stated):
        raise InputError(f"{ABOUT} of the unit {about['name']} was changed after its export: export the scenario again")
    return about
