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
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

from tests.capture.scenes import ARM, BOUNDS, TARGET
from tests.hostile import captures, friction
from tests.hostile.cases import Case, Command
from tests.hostile.documents import Map, text
from tests.hostile.drawing import Logs, drawn
from tests.hostile.judge import complaint

CPU_LIMIT_S, WALL_LIMIT_S = 20, 120
MEMORY_LIMIT = 3 << 30
_BATCH = 100
# What commands import when they need it, and what these import in turn.
_COSTLY = (
    *(
        "ffsm_mj.cli.commands",
        "ffsm_mj.present.animation",
        "ffsm_mj.present.export",
        "pandas",
        "pyarrow.compute",
        "pyarrow.pandas_compat",
        "scipy.linalg",
    ),
    *("PIL.GifImagePlugin", "matplotlib.style"),
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
            (folder / name).write_bytes(content)


def run_case(hostile: Case, number: int, folder: Path) -> Result:
    """Give the commands of a case in its folder."""
    write_case(hostile, folder)
    os.chdir(folder)
    started, codes, stderr, wrong = time.perf_counter(), [], "", ""
    for command in hostile.commands:
        with _captured(folder / ".stderr") as path:
            code = _command(command)
        stderr = path.read_text(errors="replace")
        codes.append(code)
        wrong = complaint(hostile, command, code, stderr)
        if wrong or code:
            break
    return Result(number, hostile.kind, tuple(codes), stderr, wrong, time.perf_counter() - started)


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
def _captured(path: Path) -> Iterator[Path]:
    """Standard error into a file, standard output away, at the level of the system: MuJoCo writes there too."""
    with path.open("wb") as err, open(os.devnull, "wb") as out:
        os.dup2(err.fileno(), 2)
        os.dup2(out.fileno(), 1)
    try:
        yield path
    finally:
        sys.stderr.flush()
        sys.stdout.flush()


def _guarded(seed: int, numbers: list[int], folder: Path, logs: Logs, results: Path) -> None:
    """In a child: run a batch, each case with its limits of time and memory."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.enable()
    faulthandler.register(signal.SIGPROF, chain=True)
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


def _died(seed: int, number: int, logs: Logs, folder: Path, status: int) -> Result:
    """Result of a case in which the process was ended."""
    stderr = (folder / str(number) / ".stderr").read_text(errors="replace")
    number_of = os.waitstatus_to_exitcode(status)
    limit = number_of == -signal.SIGPROF or "Timeout (" in stderr
    what = "over the time limit" if limit else f"the process died ({number_of})"
    shutil.rmtree(folder / str(number), ignore_errors=True)
    return Result(number, drawn(seed, number, logs).kind, (number_of,), stderr, what, float(CPU_LIMIT_S) if limit else 0.0)


def work(seed: int, numbers: list[int], folder: Path, results: Path) -> None:
    """All cases of a worker."""
    logs = logs_of_runs(folder)
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


def logs_of_runs(folder: Path) -> Logs:
    """Logs: the case study without a hit, two balls with one, a capture, friction. By the way loads what costs time."""
    import ffsm_mj
    from tests.scenes import two_balls

    for module in _COSTLY:
        import_module(module)
    ffsm_mj.run("coasting", {"duration_s": 0.1}, out=folder / "logs" / "a", rerun=False)
    (folder / "logs" / "models").mkdir()
    ffsm_mj.run(two_balls(folder / "logs" / "models", gap=0.01, duration_s=0.05), out=folder / "logs" / "b", rerun=False)
    held = {"robot.xml": ARM.encode(), "object.xml": TARGET.encode()}
    capture = _log_of(folder / "logs" / "c", captures.scenario(BOUNDS), held)
    rubbed = _log_of(folder / "logs" / "d", friction.scenario(), friction.models())
    return Logs(*((folder / "logs" / name / "run.mcap").read_bytes() for name in "ab"), capture, rubbed)


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
