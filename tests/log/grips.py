"""A kind of record for tests, and a function that passes it through all sinks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.run import file_sinks
from ffsm_mj.log.recorder import MemorySink
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.records import kinds as register_of_kinds
from ffsm_mj.records.kinds import ArrowColumns, Mark, RecordKind
from ffsm_mj.records.record import ByName, Values, declared, record
from ffsm_mj.records.signals import momentum_keys


@record
class Grip:
    """Two geoms grip each other."""

    time_s: float = declared("Time at which the grip starts or ends.")
    geoms: tuple[str, ...] = declared("The two geoms.", components="ab")
    point_m: Values = declared("Position in world axes.", components="xyz")
    holds: int = declared("1 if the grip starts, 0 if it ends.")
    wrench_N: ByName = declared("Force and moment by body.", entries={"ball": 2})
    words: Mapping[str, str] = declared("Texts by name.")


def marks(grip):
    yield Mark(grip.point_m, (0.0, 1.0, 0.0), 0.7, f"{grip.wrench_N['ball'][0]:g} N", "jaw")
    yield Mark(grip.point_m, text="held" if grip.holds else "released")


def arrows(layout):
    """The robot's momentum, drawn as a force, and its angular momentum, at the place of the target."""
    keys = momentum_keys("robot")
    point = layout.places(("state.q_target_x_m", *keys[1:3]))  # the target slides along x, and P has no y or z
    yield ArrowColumns("pull", "pull", layout.places(keys[:3]), point)
    yield ArrowColumns("twist", "twist", layout.places(keys[3:]), point, unit="N m")


GRIP = RecordKind(
    record=Grip,
    name="grip",
    plural="grips",
    when="when something is gripped or released",
    time=lambda grip: grip.time_s,
    sentence=lambda grip: f"grip of {' and '.join(grip.geoms)}, holds {grip.holds}",
    summary=lambda grip: {"time_s": grip.time_s, "geoms": list(grip.geoms), "holds": grip.holds},
    marks=lambda grip: list(marks(grip)),
    state=lambda grip: "held" if grip.holds else "free",
    warning=lambda grip: not grip.holds,
)
FIRST = Grip(0.1, ("ball", "target"), (0.2, 0.05, 0.0), 1, {"ball": (1.5, -2.0)}, {"why": "armed"})
LAST = replace(FIRST, time_s=0.45, holds=0, words={})


def recorded(run, folder, *happened, kinds=("grip",)):
    """A run with additional records, passed to the sinks of a run folder; as kept in memory and as read from disk."""
    header, rows, time = replace(run.log.header, kinds=kinds), run.log.rows, run.time
    place, memory = RunFolder(folder), MemorySink()
    sinks = [memory, *file_sinks(place, header, compile_log(run.log), with_rerun=True, view_rate_hz=50.0)]
    for sink in sinks:
        sink.open(header)
    begun = 0
    for event in sorted((*run.log.events, *happened), key=lambda event: register_of_kinds.kind_of(event).time(event)):
        end = int(np.searchsorted(time, register_of_kinds.kind_of(event).time(event), side="right"))
        for sink in sinks:
            if end > begun:
                sink.rows(rows[begun:end])
            sink.event(event)
            sink.flush()
        begun = max(begun, end)
    for sink in sinks:
        sink.rows(rows[begun:])
        sink.close(run.log.outcome)
    found = Run(memory.log())
    place.write_summary(ffsm_mj.summary(found))
    return found, ffsm_mj.load_run(folder)
