"""The models of a run from its log alone, compiled again."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ruamel.yaml import YAML

from ffsm_mj.log.memory_sink import RunLog
from ffsm_mj.model import System, compile_system


def compile_log(log: RunLog) -> System:
    """Compile what the log carries; control laws of others need not be installed for that.

    Raises:
        InputError: A model is missing from the log or does not compile any more.
    """
    data = YAML(typ="safe", pure=True).load(log.header.scenario_yaml)
    with tempfile.TemporaryDirectory(prefix="ffsm-") as folder:
        root = Path(folder)
        for name, content in log.header.files.items():
            file = root / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        objects = {name: root / part["mjcf"] for name, part in data.get("objects", {}).items()}
        return compile_system(
            root / data["robot"]["mjcf"],
            objects,
            time_step_s=float(data["time_step_s"]),
            conservative=log.header.facts.get("conservative") == "true",
        )
