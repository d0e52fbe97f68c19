"""The judge of hostile cases sees each fault that it is there for: one is put in on purpose, and its case is bad."""

from __future__ import annotations

import json
import shutil
import sys
import warnings
from pathlib import Path

import pytest

from tests.hostile import worker
from tests.hostile.cases import Case

_CASE = Case("made up", {"run.mcap": b"x"}, (("analyze", "run.mcap"),), links=(("link", "../outside/precious"),))
_LINE = "run.mcap: not an MCAP file"


def _traceback():
    raise ValueError("no such thing")


def _warning():
    sys.stderr.write(warnings.formatwarning("overflow encountered", RuntimeWarning, "numpy.py", 3))
    print(_LINE, file=sys.stderr)
    return 2


def _says(text, code=2, stream="stderr"):
    def fault():
        print(text, file=getattr(sys, stream))
        if stream == "stdout" and code:
            print(_LINE, file=sys.stderr)
        return code

    return fault


def _writes(path, by=Path.write_text):
    def fault():
        by(Path(path), "x")
        return 0

    return fault


def _outside_python(path, _):
    """Behind the back of Python's audit: found by what became of the canaries."""
    import subprocess

    subprocess.run(["cp", "run.mcap", str(path)], check=True)


def _endless():
    while True:
        pass


def _removes_canary():
    shutil.rmtree("../outside/folder")
    return 0


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "complaint"),
    [
        (_says(_LINE), ""),
        (_says("fine", 0, "stdout"), ""),
        (_traceback, "stderr holds 'Traceback'"),
        (_warning, "stderr holds 'Warning'"),
        (_says("WARNING: Inertia matrix is too close to singular"), "stderr holds 'WARNING'"),
        (_says("", 7), "exit code 7"),
        (lambda: 0 if print("noise", file=sys.stderr) is None else 1, "exit code 0 with 1 lines on stderr"),
        (_says("it went wrong"), "no file or place in: it went wrong"),
        (_says(f"{_LINE} \x1b[31m"), "prints '\\x1b'"),
        (_says("a name \u202e", 2, "stdout"), "prints '\\u202e'"),
        (_writes("link"), "wrote outside: precious"),
        (_writes("../outside/new", _outside_python), "wrote outside: new"),
        (_removes_canary, "wrote outside: folder/kept"),
        (_writes("../../elsewhere"), "wrote outside: "),
        (_writes("run.csv"), "only reads, and wrote run.csv"),
        (_endless, "over the time limit"),
    ],
)
def test_a_fault_is_seen(tmp_path, monkeypatch, fault, complaint):
    monkeypatch.setattr(worker, "CPU_LIMIT_S", 0.3)
    monkeypatch.setattr(worker, "logs_of_runs", lambda *_, **__: None)
    monkeypatch.setattr(worker, "drawn", lambda *_: _CASE)
    monkeypatch.setattr(worker, "_command", lambda _: _guarded(fault))
    monkeypatch.setattr(worker, "_alone", lambda: None)
    (tmp_path / "cases").mkdir()
    results = tmp_path / "results"
    results.touch()
    worker.work(1, [0], tmp_path / "cases", results)
    (result,) = map(json.loads, results.read_text().splitlines())
    assert result["complaint"].startswith(complaint), result
    assert bool(result["complaint"]) == bool(complaint)


def _guarded(fault):
    """What :func:`tests.hostile.worker._command` makes of a command that raises."""
    import traceback

    # Not those that pytest keeps.
    sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
    try:
        return fault()
    except ValueError:
        traceback.print_exc()
        return 1
