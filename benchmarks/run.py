"""Speed as ratios within one run: bare MuJoCo, detection, the whole baseline, its logs, the Riccati solvers, a cold process.

``uv run --extra fast --extra peers python benchmarks/run.py`` prints medians and spread over interleaved repeats; without
the extra ``fast`` the compiled rows are left out, without ``peers`` the other engines; ``--repeats 3`` is quicker. "Bare"
is the Python loop of ``mj_step`` on the baseline's model (RK4, 1 ms, contacts on) for 30 s.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()  # before numpy is imported: a second thread only spins on matrices this small

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import contextmanager
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import peers
from ffsm_controllers.osdre.riccati import from_eigenvectors, planar_riccati
from ffsm_controllers.osdre.riccati_doubling import Doubling
from ffsm_controllers.osdre.riccati_planar import principal_axes, turned

import ffsm_mj
from ffsm_mj.assembly.prepare import Prepared, prepare
from ffsm_mj.compiled import fastest, is_compiled
from ffsm_mj.contact.course import Course
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.regimes import Scene
from ffsm_mj.impact.time_of_impact import Detector
from ffsm_mj.log.mcap.sink import McapSink
from ffsm_mj.log.partial_file import PartialFile
from ffsm_mj.log.recorder import BLOCK_ROWS
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.motion.motion import Motion
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.recount import recount

STEPS = 30_000
PAIRS = ("gripper", "link_1", "link_2", "link_3", "base")


def fresh(*, contacts: bool):
    """Model and data of the baseline at its start."""
    assembly = prepare("baseline").assemble()
    bit = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model = assembly.system.mj
    model.opt.disableflags = model.opt.disableflags & ~bit if contacts else model.opt.disableflags | bit
    return assembly, model, assembly.data


def bare(*, contacts: bool) -> float:
    """30 s of mj_step in a Python loop, the arm moving."""
    _, model, data = fresh(contacts=contacts)
    data.qvel[3:6] = 0.1
    start = time.perf_counter()
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
    return time.perf_counter() - start


def forwarded(*, pairs: tuple[str, ...]) -> float:
    """30 s of step and forward, contacts off, with so many pairs watched (none: the same loop without detection)."""
    assembly, model, data = fresh(contacts=False)
    data.qvel[3:6] = 0.1
    data.qpos[6] = -6.0  # out of reach: nothing is resolved here, so nothing may touch
    mujoco.mj_forward(model, data)
    watched = [ContactPair(assembly.system, name, name, "object/box", 1.0) for name in pairs]
    course = Course(Motion(model, data), [Detector(Scene(assembly.system, data), watched)])
    start = time.perf_counter()
    if watched:
        for _ in range(STEPS):
            course.advance(0.001)
    else:
        for _ in range(STEPS):
            mujoco.mj_step(model, data)
            mujoco.mj_forward(model, data)
    return time.perf_counter() - start


def closed() -> float:
    """The gripper rests on the box, nothing presses: every step looks for a touch and for an overlap. 1 s, times thirty."""
    assembly, model, data = fresh(contacts=False)
    pair = ContactPair(assembly.system, "hit", "gripper", "object/box", 0.0)
    data.qpos[6] += float(data.geom("robot/gripper").xpos[0] - 0.501 - data.qpos[6])
    data.qpos[7] = data.geom("robot/gripper").xpos[1]
    mujoco.mj_forward(model, data)
    data.qpos[6] += pair.proximity(model, data).gap
    mujoco.mj_forward(model, data)
    detector = Detector(Scene(assembly.system, data), [pair])
    course = Course(Motion(model, data), [detector])
    start = time.perf_counter()
    for _ in range(STEPS // 30):
        course.advance(0.001)
    deepest = detector.columns[0]
    deepest.note(0.0)
    assert deepest.live[0] < 1e-12
    return 30.0 * (time.perf_counter() - start)


def recounting() -> float:
    """What `analyze` does with the baseline's log: every step flown again, every number compared."""
    _, log = logged()
    start = time.perf_counter()
    assert recount(log).agrees
    return time.perf_counter() - start


def whole(*, out: bool, rerun: bool) -> float:
    """The baseline with everything on; in memory, with MCAP, with MCAP and Rerun. Imports and set-up are excluded."""
    with tempfile.TemporaryDirectory() as folder:
        prepared = prepare("baseline")
        start = time.perf_counter()
        prepared.run(folder=RunFolder(Path(folder) / "run") if out else None, rerun=rerun)
        return time.perf_counter() - start


@cache
def logged() -> tuple[Prepared, RunLog]:
    """The baseline and its log, in memory."""
    prepared = prepare("baseline")
    return prepared, prepared.run().log


def writing() -> float:
    """The baseline's rows into a log file, and nothing else: samples and viewer topics."""
    prepared, log = logged()
    with tempfile.TemporaryDirectory() as folder:
        take = partial(PartialFile.begun, Path(folder) / "run.mcap")
        sink = McapSink(take, prepared.system, prepared.scenario.log.view_rate_hz)
        start = time.perf_counter()
        sink.open(log.header)
        for first in range(0, len(log.rows), BLOCK_ROWS):
            sink.rows(log.rows[first : first + BLOCK_ROWS])
        sink.close(log.outcome)
        return time.perf_counter() - start


def three_outputs(solver: str) -> float:
    """Seconds per solution for three outputs along a smooth path."""
    rng = np.random.default_rng(0)
    ends = [rng.normal(size=(2, 3, k)) for k in (3, 3, 4)]
    Q, count, total = np.diag([1.0] * 3 + [0.5] * 3), 300, 0.0
    blocks = fastest(Doubling)(Q)
    for k in range(count):
        A21, A22, B2 = (np.cos(0.001 * k) * first + np.sin(0.001 * k) * second for first, second in ends)
        A = np.block([[np.zeros((3, 3)), np.eye(3)], [A21, A22]])
        B = np.vstack((np.zeros_like(B2), B2))
        start = time.perf_counter()
        if solver == "doubling":
            blocks.solve(A21, A22, B2 @ B2.T)
        else:
            scipy_care(A, B, Q)
        total += time.perf_counter() - start
    return total / count


def riccati(solver: str) -> float:
    """Seconds per solution along a smooth path of problems, warm-started where the solver can."""
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(2, 2, 4)), rng.normal(size=(2, 2, 4))
    left, right = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
    Q, count = np.diag([1.0, 1.0, 0.5, 0.5]), 500
    planar, total = planar_riccati(Q), 0.0
    for k in range(count):
        A, S = np.zeros((4, 4)), np.zeros((4, 4))
        angle = 0.001 * k
        A[:2, 2:], A[2:] = np.eye(2), np.cos(angle) * first[0] + np.sin(angle) * second[0]
        B2 = np.cos(angle) * left + np.sin(angle) * right
        S[2:, 2:] = B2 @ B2.T
        values, axes = principal_axes(*S[2:, 2:].ravel()[[0, 1, 3]].tolist())
        lower = [turned(tuple(block.ravel().tolist()), axes) for block in (A[2:, :2], A[2:, 2:])]
        start = time.perf_counter()
        if solver == "structured":
            planar.solve(*lower, values, axes)
        elif solver == "eigenvectors":
            from_eigenvectors(A, S, Q)
        else:
            scipy_care(A, np.vstack((np.zeros((2, 3)), B2)), Q)
        total += time.perf_counter() - start
    return total / count


def scipy_care(A, B, Q):
    """SciPy's Schur method, the oracle."""
    from scipy.linalg import solve_continuous_are

    return solve_continuous_are(A, B, Q, np.eye(B.shape[1]))


def plain(row: Callable[[], float]) -> float:
    """A row without the compiled twins."""
    with switched("0"):
        return row()


def compiled(row: Callable[[], float]) -> float:
    """A row with them."""
    with switched("1"):
        return row()


@contextmanager
def switched(value: str):
    """Set FFSM_COMPILED for a while."""
    before = os.environ.get("FFSM_COMPILED", "1")
    os.environ["FFSM_COMPILED"] = value
    try:
        yield
    finally:
        os.environ["FFSM_COMPILED"] = before


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
data.qvel[3:6] = 0.1
for _ in range({STEPS}):
    mujoco.mj_step(model, data)
"""
RUN_PROCESS = 'from ffsm_mj.cli.main import main; main(["run", "baseline", "--no-rerun"])'
HELP_PROCESS = 'from ffsm_mj.cli.main import main\ntry: main(["--help"])\nexcept SystemExit: pass'

BARE, SCIPY, SCIPY_3 = "bare loop, contacts on", "Riccati, SciPy", "Riccati, 3 outputs, SciPy"
NO_DETECTION, BARE_COLD = "step and forward, no detection", "cold process, bare loop"
MEMORY, MCAP = partial(whole, out=False, rerun=False), partial(whole, out=True, rerun=False)
ROWS: dict[str, tuple[Callable[[], float], str]] = {
    BARE: (partial(bare, contacts=True), BARE),
    "bare loop, contacts off": (partial(bare, contacts=False), BARE),
    NO_DETECTION: (partial(forwarded, pairs=()), NO_DETECTION),
    "detection of five pairs": (partial(plain, partial(forwarded, pairs=PAIRS)), NO_DETECTION),
    "the same, compiled": (partial(compiled, partial(forwarded, pairs=PAIRS)), NO_DETECTION),
    "detection of a pair in contact": (partial(plain, closed), NO_DETECTION),
    "baseline, log in memory": (partial(plain, MEMORY), BARE),
    "baseline, in memory, compiled": (partial(compiled, MEMORY), BARE),
    "baseline, MCAP": (partial(plain, MCAP), BARE),
    "baseline, MCAP, compiled": (partial(compiled, MCAP), BARE),
    "writing the MCAP alone": (writing, BARE),
    "recount of the log": (partial(plain, recounting), BARE),
    "baseline, MCAP and Rerun": (partial(plain, partial(whole, out=True, rerun=True)), BARE),
    "Riccati, structured": (partial(plain, partial(riccati, "structured")), SCIPY),
    "Riccati, structured, compiled": (partial(compiled, partial(riccati, "structured")), SCIPY),
    "Riccati, eigenvectors": (partial(riccati, "eigenvectors"), SCIPY),
    SCIPY: (partial(riccati, "scipy"), SCIPY),
    "Riccati, 3 outputs, doubling": (partial(plain, partial(three_outputs, "doubling")), SCIPY_3),
    "Riccati, 3 outputs, compiled": (partial(compiled, partial(three_outputs, "doubling")), SCIPY_3),
    SCIPY_3: (partial(three_outputs, "scipy"), SCIPY_3),
    BARE_COLD: (partial(cold, BARE_PROCESS), BARE_COLD),
    "cold process, ffsm run": (partial(plain, partial(cold, RUN_PROCESS)), BARE_COLD),
    "cold process, ffsm run, compiled": (partial(compiled, partial(cold, RUN_PROCESS)), BARE_COLD),
    "interpreter alone": (partial(cold, "pass"), "interpreter alone"),
    "ffsm --help": (partial(cold, HELP_PROCESS), "interpreter alone"),
}


def main() -> None:
    """Run every row in turn, several times, and print medians, spread and ratios to each row's reference."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    import rerun  # noqa: F401 (its import is not part of writing)

    rows = {name: row for name, row in ROWS.items() if "compiled" not in name or is_compiled()}
    for row, _ in rows.values():
        row()
    times: dict[str, list[float]] = {name: [] for name in rows}
    for _ in range(repeats):
        for name, (row, _) in rows.items():
            times[name].append(row())
    print(f"{'':32}{'median':>12}{'min':>12}{'max':>12}{'ratio':>8}  to")
    for name, (_, reference) in rows.items():
        ratio = statistics.median(a / b for a, b in zip(times[name], times[reference], strict=True))
        values = [
            f"{x:.3f} s" if x > 1e-2 else f"{1e6 * x:.1f} us"
            for x in (statistics.median(times[name]), min(times[name]), max(times[name]))
        ]
        print(f"{name:32}" + "".join(f"{v:>12}" for v in values) + f"{ratio:8.2f}  {reference}")
    if find_spec("pinocchio"):  # it gives the reference solution
        print()
        peers.report(repeats)


if __name__ == "__main__":
    main()
