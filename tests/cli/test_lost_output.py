"""Output that cannot be written: told in one line, never a success; places are tried before the work."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.report import plots
from tests.scenes import two_balls
from tests.terminal import ffsm

FULL = Path("/dev/full")


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")


@pytest.fixture
def run(tmp_path, capsys) -> str:
    """A short run."""
    assert main(["run", str(two_balls(tmp_path, duration_s=0.1)), "--no-rerun", "--out", "a"]) == 0
    capsys.readouterr()
    return "a"


def on_full_disk(*arguments):
    """A command whose stdout is a full device."""
    with FULL.open("w") as full:
        return subprocess.run(ffsm(*arguments), stdout=full, stderr=subprocess.PIPE, text=True, check=False)


@contextmanager
def no_room(monkeypatch) -> Iterator[None]:
    """Every file ends after 100 bytes: like a full disk, the writer is told so by the operating system."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # or what is imported meanwhile is cut in the cache
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.long
@pytest.mark.parametrize("arguments", ["analyze a", "schema", "run --list", "-h", ""])
@pytest.mark.usefixtures("run")
def test_a_full_stdout_is_no_success(arguments):
    process = on_full_disk(*arguments.split())
    assert (process.returncode, process.stderr) == (3, "stdout: output is lost (No space left on device)\n")


@pytest.mark.long
def test_a_run_that_cannot_report_is_whole_and_keeps_its_own_exit_code(tmp_path):
    path = str(two_balls(tmp_path, duration_s=0.5))
    process = on_full_disk("run", path, "--no-rerun", "--out", "a")
    assert (process.returncode, process.stderr) == (3, "stdout: output is lost (No space left on device)\n")
    assert main(["analyze", "a"]) == 0
    process = on_full_disk("analyze", "a", "--tolerance", "1e-30")
    assert process.returncode == 1
    assert process.stderr == "stdout: output is lost (No space left on device)\n"


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("arguments", [["--help"], ["schema"], ["analyze", "a"], ["run", "a", "--no-rerun", "--out", "b"]])
@pytest.mark.usefixtures("run")
def test_a_reader_who_has_gone_is_no_failure(arguments):
    """``ffsm ... | head -0``; a run is whole."""
    read, write = os.pipe()
    os.close(read)
    process = subprocess.run(ffsm(*arguments), stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert (process.returncode, process.stderr) == (0, "")
    assert arguments[0] != "run" or ffsm_mj.load_run("b").complete


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # imageio-ffmpeg leaves its pipe open
@pytest.mark.parametrize("form", ["--csv --table impacts", "--csv", "--parquet", "--gif", "--mp4", "--html"])
def test_a_file_on_a_full_disk_is_lost(form, run, capsys, monkeypatch):
    """An earlier file of that name stays as it was, and nothing is left beside it."""
    name = f"x.{form.split()[0][2:]}"
    Path(name).write_text("earlier")
    with no_room(monkeypatch):
        assert main(["export", run, *form.split(), "--out", name]) == 3
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"{name}: output is lost (")
    assert captured.err.count("\n") == 1
    assert Path(name).read_text() == "earlier"
    assert sorted(os.listdir()) == ["a", name]


@pytest.mark.long
@pytest.mark.parametrize("form", ["--csv --table impacts", "--parquet", "--gif", "--mp4", "--html"])
def test_a_link_is_replaced_and_never_written_through(form, run, tmp_path, capsys):
    """A run folder may be a stranger's, and what an export is called by itself is known."""
    (tmp_path / "precious").write_text("mine")
    names = {"--csv": "impacts.csv", "--parquet": "samples.parquet", "--html": "run.html"}
    name = Path(run, names.get(form.split()[0], f"motion.{form[2:]}"))
    name.symlink_to(tmp_path / "precious")
    assert main(["export", run, *form.split()]) == 0, capsys.readouterr().err
    assert (tmp_path / "precious").read_text() == "mine"
    assert name.is_file()
    assert not name.is_symlink()


def test_an_interrupted_export_leaves_the_earlier_file_whole(run, capsys, monkeypatch):
    assert main(["export", run, "--csv"]) == 0
    earlier = Path(run, "samples.csv").read_bytes()

    def interrupted(stream, *_):
        stream.write(b"time_s,")
        raise KeyboardInterrupt

    monkeypatch.setattr("ffsm_mj.report.export._writer", interrupted)
    before = sorted(os.listdir(run))
    assert main(["export", run, "--csv"]) == 130
    assert capsys.readouterr().err == "interrupted\n"
    assert Path(run, "samples.csv").read_bytes() == earlier
    assert sorted(os.listdir(run)) == before


def test_figures_on_a_full_disk_are_lost(run, capsys, monkeypatch):
    every = plots._makers
    monkeypatch.setattr(plots, "_makers", lambda run, _: every(run, ["energies"]))
    with no_room(monkeypatch):
        assert main(["analyze", run, "--plots", "figures"]) == 3
    assert capsys.readouterr().err == "figures/energies.png: output is lost (File too large)\n"
    assert os.listdir("figures") == []


LONG = "x" * 300


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("analyze a --plots file", "file: cannot be used as a folder to write to (File exists)"),
        ("analyze a --plots file/x", "file/x: cannot be used as a folder to write to (Not a directory)"),
        (f"analyze a --plots {LONG}", f"{LONG}: cannot be used as a folder to write to (File name too long)"),
        ("analyze a --plots /proc/x", "/proc/x: cannot be used as a folder to write to (No such file or directory)"),
        (f"export a --csv --out {LONG}", f"{LONG}: cannot be written (File name too long)"),
        ("export a --csv --out folder", "folder: is a folder; name the file to write"),
        ("export a --gif --out file/x.gif", "file/x.gif: cannot be written (Not a directory)"),
        ("export a --mp4 --out /proc/x.mp4", "/proc: cannot be used as a folder to write to (No such file or directory)"),
        (f"run baseline --out {LONG}", f"{LONG}"),
        (f"run {LONG}", f"{LONG}"),
        (f"analyze {LONG}", f"{LONG}"),
    ],
)
@pytest.mark.usefixtures("run")
def test_a_place_that_cannot_be_used_is_refused_before_the_work(arguments, message, capsys, monkeypatch):
    Path("file").touch()
    Path("folder").mkdir()
    for work in ("ffsm_mj.analysis.run.read_log", "ffsm_mj.simulation.loop.Simulation.run"):
        monkeypatch.setattr(work, lambda *_: pytest.fail("it was done"))
    assert main(arguments.split()) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(message)
    assert captured.err.count("\n") == 1
