"""Rerun recording made from a log: the models are compiled from the files in the log."""

from __future__ import annotations

from pathlib import Path

from ffsm_mj.errors import THE_LOG, InputError
from ffsm_mj.log.rerun.sink import RerunSink
from ffsm_mj.log.scenario import compile_log, logged_scenario
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import coordinate_keys

_BLOCKS_AT_ONCE = 25


def write_recording(log: RunLog, path: Path) -> None:
    """Write a recording (``.rrd``) of a log.

    Raises:
        InputError: The models in the log no longer compile, or do not match its columns.
    """
    system = compile_log(log)
    if missing := set(coordinate_keys(system.joints.values())) - set(log.header.layout.keys):
        raise InputError(f"{THE_LOG} has no {min(missing)}, a coordinate of its models")
    sink = RerunSink(lambda: path, system, logged_scenario(log).view_rate_hz)
    sink.open(log.header)
    for event in log.events():
        sink.event(event)
    for number, block in enumerate(log.blocks(), 1):
        sink.rows(block)
        if number % _BLOCKS_AT_ONCE == 0:
            sink.flush()
    sink.close(log.outcome)
