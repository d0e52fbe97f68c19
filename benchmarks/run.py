"""Speed as ratios within one run: bare MuJoCo, detection, whole runs, their logs, the Riccati solvers, a cold process.

``uv run --extra peers python benchmarks/run.py`` prints medians, spread and goals over interleaved repeats;
without the extra ``peers`` the other engines are left out; ``--repeats 3`` is quicker.
"Bare" is the Python loop of ``mj_step`` on the model of the same scenario, for as many steps, contacts on, the arm moving.
Seconds are CPU time; of cold processes, which wait for the disk too, wall time.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()  # before numpy is imported: a second thread only spins on matrices this small

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import mujoco
import peers
import riccati
import scenes
from loops import ARM_RATE, bare, fresh, in_memory, steps, stir

import ffsm_mj
from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.assembly.run import simulate
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.impact.time_of_impact import Detector
from ffsm_mj.contact_models.interface import Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.log.mcap.sink import McapSink
from ffsm_mj.log.recorder import RECORDED_ROWS
from ffsm_mj.log.run_folder import PartialFile, RunFolder
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.replay import replay_log
from ffsm_mj.simulation.integrator import EventDrivenIntegrator

PAIRS = ("gripper", "link_1", "link_2", "link_3", "base")
BASELINE = prepare("baseline")
STEPS = steps(BASELINE)


def forwarded(*, pairs: tuple[str, ...]) -> float:
    """30 s of step and forward, contacts off, with so many pairs watched (none: the same loop without detection)."""
    assembly = fresh(BASELINE, contacts=False)
    stir(assembly)
    model, data = assembly.system.mj, assembly.data
    data.qpos[6] = -6.0  # out of reach: nothing is resolved here, so nothing may touch
    mujoco.mj_forward(model, data)
    watched = [ContactPair(assembly.system, name, name, "object/box", 1.0) for name in pairs]
    course = EventDrivenIntegrator(Motion(model, data), [Detector(Scene(assembly.system, data), watched)])
    start = time.process_time()
    if watched:
        for _ in range(STEPS):
            course.advance(0.001)
    else:
        for _ in range(STEPS):
            mujoco.mj_step(model, data)
            mujoco.mj_forward(model, data)
    return time.process_time() - start


def closed() -> float:
    """The gripper rests on the box, nothing presses: every step looks for a touch and for an overlap. 1 s, times thirty."""
    assembly = fresh(BASELINE, contacts=False)
    model, data = assembly.system.mj, assembly.data
    pair = ContactPair(assembly.system, "hit", "gripper", "object/box", 0.0)
    data.qpos[6] += float(data.geom("robot/gripper").xpos[0] - 0.501 - data.qpos[6])
    data.qpos[7] = data.geom("robot/gripper").xpos[1]
    mujoco.mj_forward(model, data)
    data.qpos[6] += pair.proximity(model, data).gap
    mujoco.mj_forward(model, data)
    detector = Detector(Scene(assembly.system, data), [pair])
    course = EventDrivenIntegrator(Motion(model, data), [detector])
    start = time.process_time()
    for _ in range(STEPS // 30):
        course.advance(0.001)
    deepest = detector.columns[0]
    deepest.on_sample(0.0)
    assert deepest.live[0] < 1e-12
    return 30.0 * (time.process_time() - start)


def log_replay() -> float:
    """What `analyze` does with the baseline's log: every step repeated, every number compared."""
    log = logged()
    start = time.process_time()
    assert replay_log(log).agrees
    return time.process_time() - start


def on_disk(*, rerun: bool) -> float:
    """The baseline with everything on, its log written as MCAP, with or without Rerun's; set-up is not counted."""
    with tempfile.TemporaryDirectory() as folder:
        assembly = BASELINE.assemble()
        start = time.process_time()
        simulate(assembly, RunFolder(Path(folder) / "run"), with_rerun=rerun)
        return time.process_time() - start


@cache
def logged() -> RunLog:
    """The baseline's log, in memory."""
    return BASELINE.run().log


def writing() -> float:
    """The baseline's rows into a log file, and nothing else: samples and viewer topics."""
    log = logged()
    with tempfile.TemporaryDirectory() as folder:
        take = PartialFile(Path(folder) / "run.mcap").begin
        sink = McapSink(take, BASELINE.system, BASELINE.scenario.log.view_rate_hz)
        start = time.process_time()
        sink.open(log.header)
        for first in range(0, len(log.rows), RECORDED_ROWS):
            sink.rows(log.rows[first : first + RECORDED_ROWS])
        sink.close(log.outcome)
        return time.process_time() - start


def cold(code: str) -> float:
    """A whole process from prompt to exit."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True, cwd=folder, stdout=subprocess.DEVNULL)
        return time.perf_counter() - start


BARE_PROCESS = f"""
import mujoco
model = mujoco.MjModel.from_xml_path({str(Path(ffsm_mj.__file__).parent.parent / "mjcf" / "ffsm_3dof.xml")!r})
model.opt.timestep = 0.001
data = mujoco.MjData(model)
data.qvel[3:6] = {ARM_RATE}
for _ in range({STEPS}):
    mujoco.mj_step(model, data)
"""
RUN_PROCESS = 'from ffsm_mj.cli.main import main; main(["run", "baseline", "--no-rerun"])'
HELP_PROCESS = 'from ffsm_mj.cli.main import main\ntry: main(["--help"])\nexcept SystemExit: pass'


class Row(NamedTuple):
    """Seconds of something, the row that it is compared with, and the ratio that is wanted, where one is."""

    measure: Callable[[], float]
    reference: str
    goal: float | None = None


def against_bare(name: str, scenario: Callable[[], PreparedRun], goal: float, *, stirred: bool = True):
    """Two rows: the bare loop of a scenario, and its run in memory."""
    reference, once = f"{name}, bare", cache(scenario)
    return {
        reference: Row(lambda: bare(once(), stirred=stirred), reference),
        f"{name}, in memory": Row(lambda: in_memory(once()), reference, goal),
    }


BARE, SCIPY, SCIPY_3 = "baseline, bare", "Riccati, SciPy", "Riccati, 3 outputs, SciPy"
NO_DETECTION, BARE_COLD = "step and forward, no detection", "cold process, bare loop"
DETECTION, MCAP = partial(forwarded, pairs=PAIRS), partial(on_disk, rerun=False)
STRUCTURED, DOUBLING = partial(riccati.two_outputs, "structured"), partial(riccati.three_outputs, "doubling")
ROWS: dict[str, Row] = {
    **against_bare("baseline", lambda: BASELINE, 1.3),
    "baseline, bare, contacts off": Row(partial(bare, BASELINE, contacts=False), BARE),
    "baseline, MCAP": Row(MCAP, BARE, 1.6),
    "writing the MCAP alone": Row(writing, BARE, 0.9),
    "baseline, MCAP and Rerun": Row(partial(on_disk, rerun=True), BARE),
    "log replay": Row(log_replay, BARE, 2.0),
    **against_bare("spatial", partial(prepare, "spatial"), 1.3),
    **against_bare("free-flying-hardware", partial(prepare, "free-flying-hardware"), 1.6),
    **against_bare("OSDRE, p = 3, 7 joints, 1 kHz", partial(scenes.regulated, 7), 1.8, stirred=False),
    NO_DETECTION: Row(partial(forwarded, pairs=()), NO_DETECTION),
    "detection of five pairs": Row(DETECTION, NO_DETECTION, 1.2),
    "detection of a pair in contact": Row(closed, NO_DETECTION),
    "Riccati, structured": Row(STRUCTURED, SCIPY),
    "Riccati, eigenvectors": Row(partial(riccati.two_outputs, "eigenvectors"), SCIPY),
    SCIPY: Row(partial(riccati.two_outputs, "scipy"), SCIPY),
    "Riccati, 3 outputs, doubling": Row(DOUBLING, SCIPY_3),
    SCIPY_3: Row(partial(riccati.three_outputs, "scipy"), SCIPY_3),
    BARE_COLD: Row(partial(cold, BARE_PROCESS), BARE_COLD),
    "cold process, ffsm run": Row(partial(cold, RUN_PROCESS), BARE_COLD, 3.0),
    "interpreter alone": Row(partial(cold, "pass"), "interpreter alone"),
    "ffsm --help": Row(partial(cold, HELP_PROCESS), "interpreter alone", 5.0),
}


def main() -> None:
    """Run every row in turn, several times, and print medians, spread and ratios to each row's reference."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    import rerun  # noqa: F401 (its import is not part of writing)

    for row in ROWS.values():
        row.measure()
    times: dict[str, list[float]] = {name: [] for name in ROWS}
    for _ in range(repeats):
        for name, row in ROWS.items():
            times[name].append(row.measure())
    print(f"{'':50}{'median':>12}{'min':>12}{'max':>12}{'ratio':>8}{'goal':>6}  to")
    for name, row in ROWS.items():
        print(line(name, row, times))
    print()
    riccati.report(repeats)
    if find_spec("pinocchio"):  # it gives the reference solution
        print()
        peers.report(repeats)


def line(name: str, row: Row, times: dict[str, list[float]]) -> str:
    """A row as text; ratios are of the same repeat."""
    ratio = statistics.median(a / b for a, b in zip(times[name], times[row.reference], strict=True))
    values = [
        f"{x:.3f} s" if x > 1e-2 else f"{1e6 * x:.1f} us"
        for x in (statistics.median(times[name]), min(times[name]), max(times[name]))
    ]
    goal = "" if row.goal is None else f"{row.goal:g}"
    return f"{name:50}" + "".join(f"{v:>12}" for v in values) + f"{ratio:8.2f}{goal:>6}  {row.reference}"


if __name__ == "__main__":
    main()
