"""A Rerun recording from a log alone: the model is rebuilt from what the log carries."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ffsm_mj.assembly import compile_scenario
from ffsm_mj.events import Event
from ffsm_mj.log.memory_sink import RunLog
from ffsm_mj.log.narration import event_time
from ffsm_mj.log.rerun_sink import RerunSink
from ffsm_mj.model import System
from ffsm_mj.scenario import Scenario, load_scenario


def write_recording(log: RunLog, path: Path, *, until_s: float | None = None) -> None:
    """Write ``path`` (.rrd) with everything that the log tells.

    Args:
        log: What is shown.
        path: The file to write.
        until_s: Leave out what happens later and open the recording there, at its end.

    Raises:
        InputError: The log's scenario or models do not compile any more.
    """
    with tempfile.TemporaryDirectory(prefix="ffsm-") as folder:
        scenario, system = _rebuild(log, Path(folder))
    sink = RerunSink(path, system, scenario.log.view_rate_hz, following=until_s is not None)
    sink.open(log.header)
    events: list[Event] = [*log.phases, *log.impacts, *log.unhandled]
    for event in sorted(events, key=event_time):
        if until_s is None or event_time(event) <= until_s:
            sink.event(event)
    sink.rows(log.rows if until_s is None else log.rows[log.rows[:, 0] <= until_s])
    sink.close(log.outcome if until_s is None else None)


def _rebuild(log: RunLog, folder: Path) -> tuple[Scenario, System]:
    for name, content in log.header.files.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    path = folder / "scenario.yaml"
    path.write_text(log.header.scenario_yaml, encoding="utf-8")
    scenario, source = load_scenario(path)
    return scenario, compile_scenario(scenario, source)
