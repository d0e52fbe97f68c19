"""Runs cases, a batch in each forked child, so that nothing is imported twice and no case harms another batch.

``python -m tests.hostile.worker SEED FIRST LAST STEP FOLDER`` writes one line of JSON per case into ``FOLDER/FIRST.jsonl``.
"""

from __future__ import annotations

import faulthandler
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

from tests.contact_models.grasp.scenes import ARM, BOUNDS, TARGET
from tests.hostile import friction, grasps
from tests.hostile.campaigns import campaign_folder, scene_files
from tests.hostile.cases import Case, Command
from tests.hostile.documents import Map, text
from tests.hostile.drawing import Logs, drawn
from tests.hostile.judge import complaint, control_character
from tests.hostile.strangers import STRANGERS
from tests.hostile.values import words
from tests.hostile.writes import listing, only_reads, put_canaries, stray, touched_canary, watched

CPU_LIMIT_S, WALL_LIMIT_S = 20, 120
MEMORY_LIMIT = 3 << 30
_BATCH = 100
# What commands import when they need it, and what these import in turn.
_COSTLY = words("""ffsm_mj.cli.analyze ffsm_mj.cli.export ffsm_mj.report.animation ffsm_mj.report.export pandas
        pyarrow.compute pyarrow.pandas_compat scipy.linalg PIL.GifImagePlugin matplotlib.style""")
_COSTLY_TOO = (
    *("ffsm_mj.experiments.campaign", "ffsm_mj.experiments.figures", "ffsm_mj.experiments.page", "scipy.stats.qmc"),
    *("ffsm_mj.report.page.document", "ffsm_mj.log.rerun.sink", "ffsm_mj.templates.robot", "imageio_ffmpeg"),
    *("ffsm_mj.cli.campaign", "ffsm_mj.report.plots", "matplotlib.backends.backend_svg", "matplotlib.backends.backend_agg"),
)


@dataclass(frozen=True)
class Result:
    """How a case went.

    Attributes:
        number: Of the case.
        kind: What is hostile about it.
        codes: Exit codes of its commands.
        stderr: What the last command said there.
        complaint: What is wrong; empty where nothing is.
        wall_s: Time that it took.
    """

    number: int
    kind: str
    codes: tuple[int, ...]
    stderr: str
    complaint: str
    wall_s: float


def write_case(hostile: Case, folder: Path) -> None:
    """Make the folder of a case."""
    folder.mkdir(parents=True)
    for name in hostile.folders:
        (folder / name).mkdir()
    for name, content in hostile.files.items():
        with suppress(OSError, ValueError):  # a name that no file can have: the case is that it is not there
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
    for name, target in hostile.links:
        with suppress(OSError):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).symlink_to(target)


def run_case(hostile: Case, number: int, folder: Path) -> Result:
    """Give the commands of a case in a folder of its own, canaries beside it."""
    here = folder / "case"
    write_case(hostile, here)
    put_canaries(folder)
    os.chdir(here)
    tempfile.tempdir = str(folder)
    started, codes, stderr, wrong = time.perf_counter(), [], "", ""
    for command in hostile.commands:
        before = listing(here) if only_reads(command) else {}
        with _grasped(folder / ".stderr", folder / ".stdout"), watched() as places:
            code = _command(command)
        stderr, stdout = ((folder / name).read_text(errors="replace") for name in (".stderr", ".stdout"))
        codes.append(code)
        wrong = complaint(hostile, command, code, stderr) or control_character(stdout, stderr)
        wrong = wrong or written(folder, command, places, before)
        if wrong or code:
            break
    return Result(number, hostile.kind, tuple(codes), stderr, wrong, time.perf_counter() - started)


def written(folder: Path, command: Command, places: Sequence[str], before: Mapping[str, tuple[int, int]]) -> str:
    """What is wrong with what a command wrote; empty where nothing is."""
    here = folder / "case"
    if canary := touched_canary(folder):
        return f"wrote outside: {canary}"
    if place := stray(places, folder, command):
        return f"wrote outside: {place}"
    if only_reads(command) and (changed := listing(here).items() ^ before.items()):
        return f"only reads, and wrote {sorted(name for name, _ in changed)[0]}"
    litter = [path.name for path in here.rglob("MUJOCO_LOG.TXT")]
    return f"left {litter[0]}" if litter else ""


def _command(arguments: Command) -> int:
    """What a process would exit with; a traceback where there would be one."""
    from ffsm_mj.cli.main import main

    try:
        return int(main(arguments))
    except SystemExit as end:
        return int(end.code or 0)
    except BaseException:  # noqa: BLE001 (the interpreter would do the same)
        traceback.print_exc()
        return 1


@contextmanager
def _grasped(errors: Path, output: Path) -> Iterator[None]:
    """Standard error and output into files, at the level of the system: MuJoCo writes there too."""
    with errors.open("wb") as err, output.open("wb") as out:
        os.dup2(err.fileno(), 2)
        os.dup2(out.fileno(), 1)
    try:
        yield
    finally:
        sys.stderr.flush()
        sys.stdout.flush()


def _guarded(seed: int, numbers: list[int], folder: Path, logs: Logs, results: Path) -> None:
    """In a child: run a batch, each case with its limits of time and memory."""
    limit = MEMORY_LIMIT + _address_space()  # of libraries that are loaded, most of it never touched
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.enable()
    faulthandler.register(signal.SIGPROF, chain=True)
    _alone()
    for number in numbers:
        place = folder / str(number)
        signal.setitimer(signal.ITIMER_PROF, CPU_LIMIT_S)
        faulthandler.dump_traceback_later(WALL_LIMIT_S, exit=True)
        result = run_case(drawn(seed, number, logs), number, place)
        signal.setitimer(signal.ITIMER_PROF, 0)
        os.chdir(folder)
        shutil.rmtree(place, ignore_errors=True)
        with results.open("a") as stream:
            stream.write(json.dumps(asdict(result)) + "\n")


def _address_space() -> int:
    """How much of it this process has, in bytes; 0 where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except OSError:
        return 0


def _alone() -> None:
    """Nothing but this process: a viewer that opens at once and ends, runs of campaigns one after the other in here."""
    from ffsm_mj.experiments import executors
    from ffsm_mj.log.rerun import viewer

    sys.dont_write_bytecode = True
    executors.pool = lambda _=None: executors.loop()
    viewer.has_display = lambda: True
    viewer.viewer_command = lambda *_, **__: ["true"]


def _died(seed: int, number: int, logs: Logs, folder: Path, status: int) -> Result:
    """Result of a case in which the process was ended."""
    said = folder / str(number) / ".stderr"
    made = said.is_file()
    stderr = said.read_text(errors="replace") if made else "the case itself could not be made"
    number_of = os.waitstatus_to_exitcode(status)
    limit = number_of == -signal.SIGPROF or "Timeout (" in stderr
    what = "over the time limit" if limit else f"the process died ({number_of})"
    shutil.rmtree(folder / str(number), ignore_errors=True)
    kind = drawn(seed, number, logs).kind if made else ""
    return Result(number, kind, (number_of,), stderr, what, float(CPU_LIMIT_S) if limit else 0.0)


def work(seed: int, numbers: list[int], folder: Path, results: Path) -> None:
    """All cases of a worker."""
    logs = logs_of_runs(folder, with_campaign=seed == STRANGERS)
    while numbers:
        batch = numbers[:_BATCH]
        child = os.fork()
        if not child:
            _guarded(seed, batch, folder, logs, results)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        done = {json.loads(line)["number"] for line in results.read_text().splitlines()}
        left = [number for number in batch if number not in done]
        if left:  # the first of them ended the process
            with results.open("a") as stream:
                stream.write(json.dumps(asdict(_died(seed, left[0], logs, folder, status))) + "\n")
            left = left[1:]
        numbers = left + numbers[_BATCH:]


def logs_of_runs(folder: Path, *, with_campaign: bool = False) -> Logs:
    """Logs: the case study without a hit, two balls with one, a capture, friction. By the way loads what costs time."""
    import ffsm_mj
    from tests.scenes import two_balls

    for module in _COSTLY:
        import_module(module)
    ffsm_mj.run("coasting", {"duration_s": 0.1}, out=folder / "logs" / "a", rerun=False)
    (folder / "logs" / "models").mkdir()
    ffsm_mj.run(two_balls(folder / "logs" / "models", gap=0.01, duration_s=0.05), out=folder / "logs" / "b", rerun=False)
    held = {"robot.xml": ARM.encode(), "object.xml": TARGET.encode()}
    capture = _log_of(folder / "logs" / "c", grasps.scenario(BOUNDS), held)
    rubbed = _log_of(folder / "logs" / "d", friction.scenario(), friction.models())
    made, scene = dict[str, bytes](), dict[str, bytes]()
    if with_campaign:
        for module in _COSTLY_TOO:
            import_module(module)
        (folder / "campaign").mkdir()
        scene = scene_files(folder / "campaign")
        made = campaign_folder(folder / "campaign")
    plain, hit = ((folder / "logs" / name / "run.mcap").read_bytes() for name in "ab")
    return Logs(plain, hit, capture, rubbed, made, scene)


def _log_of(folder: Path, scenario: Map, models: dict[str, bytes]) -> bytes:
    import ffsm_mj

    folder.mkdir()
    for name, content in (*models.items(), ("scenario.yaml", text(scenario).encode())):
        (folder / name).write_bytes(content)
    ffsm_mj.run(folder / "scenario.yaml", out=folder / "run", rerun=False)
    return (folder / "run" / "run.mcap").read_bytes()


if __name__ == "__main__":
    seed, first, last, step = (int(word) for word in sys.argv[1:5])
    here = Path(sys.argv[5]) / str(first)
    here.mkdir(parents=True)
    file = Path(sys.argv[5]) / f"{first}.jsonl"
    file.touch()
    work(seed, list(range(first, last, step)), here, file)
