"""A Rerun recording from a log alone: the model is rebuilt from what the log carries."""

from __future__ import annotations

from pathlib import Path

from ffsm_mj.log.model import compile_log
from ffsm_mj.log.rerun.sink import RerunSink
from ffsm_mj.log.scenario import logged_scenario
from ffsm_mj.records.run_log import RunLog

_BLOCKS_AT_ONCE = 25


def write_recording(log: RunLog, path: Path) -> None:
    """Write ``path`` (.rrd) with everything that the log tells.

    Raises:
        InputError: The log's models do not compile any more.
    """
    sink = RerunSink(lambda: path, compile_log(log), logged_scenario(log).view_rate_hz)
    sink.open(log.header)
    for event in log.events():
        sink.event(event)
    for number, block in enumerate(log.blocks(), 1):
        sink.rows(block)
        if number % _BLOCKS_AT_ONCE == 0:
            sink.flush()
    sink.close(log.outcome)
