"""A Rerun recording from a log alone: the model is rebuilt from what the log carries."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ffsm_mj.assembly import compile_scenario
from ffsm_mj.events import Event
from ffsm_mj.log.memory_sink import RunLog
from ffsm_mj.log.rerun_sink import RerunSink
from ffsm_mj.model import System
from ffsm_mj.scenario import Scenario, load_scenario


def write_recording(log: RunLog, path: Path) -> None:
    """Write ``path`` (.rrd) with everything that the log tells.

    Raises:
        InputError: The log's scenario or models do not compile any more.
    """
    with tempfile.TemporaryDirectory(prefix="ffsm-") as folder:
        scenario, system = _rebuild(log, Path(folder))
    sink = RerunSink(path, system, scenario.log.view_rate_hz)
    sink.open(log.header)
    events: list[Event] = [*log.phases, *log.impacts, *log.unhandled]
    for event in events:
        sink.event(event)
    sink.rows(log.rows)
    sink.close(log.outcome)


def _rebuild(log: RunLog, folder: Path) -> tuple[Scenario, System]:
    for name, content in log.header.files.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    path = folder / "scenario.yaml"
    path.write_text(log.header.scenario_yaml, encoding="utf-8")
    scenario, source = load_scenario(path)
    return scenario, compile_scenario(scenario, source)
