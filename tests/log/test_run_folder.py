"""The run folder: which run owns it, when it appears, what ``--force`` replaces; with kills and simultaneous runs."""

from __future__ import annotations

import json
import os
import random
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.errors import LogError
from ffsm_mj.log.run_folder import PartialFile, find_log
from tests.scenes import ball, two_balls


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")


def run(path, *arguments):
    return main(["run", str(path), "--no-rerun", *arguments])


def python(code, *arguments):
    """Start a Python process with some code."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def files(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if not path.is_dir()}


MANY = """
import contextlib, io, json, multiprocessing, sys
import ffsm_mj
from ffsm_mj.cli.main import main

def run(arguments):
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        return main(arguments), said.getvalue().strip()

if __name__ == "__main__":
    arguments = ["run", sys.argv[1], "--no-rerun", *sys.argv[3:]]
    ffsm_mj.run(sys.argv[1])  # everything is imported once
    with multiprocessing.get_context("fork").Pool(12) as pool:
        print(json.dumps(pool.map(run, [arguments] * int(sys.argv[2]), chunksize=1)))
"""


def many(path, count, *arguments):
    """Exit codes and outputs of runs, 12 at a time."""
    done = python(MANY, path, count, *arguments)
    out, err = done.communicate(timeout=200)
    assert done.returncode == 0, err
    return json.loads(out)


@pytest.mark.long
@pytest.mark.parametrize("batch", range(9))
def test_100_runs_12_at_a_time_give_100_folders(tmp_path, batch):  # noqa: ARG001
    done = many(two_balls(tmp_path, duration_s=0.05, gap=0.02), 12)
    assert {code for code, _ in done} == {0}
    logs = tmp_path / "cwd" / "logs"
    folders = [path for path in logs.iterdir() if not path.is_symlink()]
    assert len(folders) == 12
    assert {str(path.relative_to(tmp_path / "cwd")) for path in folders} == {
        line.removeprefix("files in ").partition(":")[0]
        for _, said in done
        for line in said.splitlines()
        if line.startswith("files in ")
    }
    first = ffsm_mj.load_run(folders[0])
    for folder in folders:
        got = ffsm_mj.load_run(folder)
        assert got.complete
        np.testing.assert_array_equal(got.log.rows, first.log.rows)
        assert json.loads((folder / "summary.json").read_text())["outcome"] == "completed"
        assert not [name for name in files(folder) if name.startswith(".") or name.endswith("partial")]
    assert (logs / "latest").resolve() in folders
    assert {path.name for path in logs.iterdir()} == {path.name for path in folders} | {"latest"}


@pytest.mark.long
def test_of_simultaneous_runs_into_one_folder_one_succeeds(tmp_path):
    done = many(two_balls(tmp_path, duration_s=0.3), 12, "--out", "mine")
    assert sorted(code for code, _ in done) == [0] + [2] * 11
    for code, said in done:
        if code == 2:
            assert said.startswith(("mine: another run is being written there;", "mine: already contains a run ("))
            assert "\n" not in said
    assert ffsm_mj.load_run("mine").complete
    assert files(tmp_path / "cwd" / "mine") >= {"run.mcap", "scenario.yaml", "summary.json", "mjcf/robot/robot.xml"}


def test_another_run_may_take_a_new_folder_before_its_log_exists(tmp_path, monkeypatch, capsys):
    """Another run takes the folder between its creation and that of the log; the first one is refused."""
    others = []

    def late(_, path, __):
        others.append(PartialFile(path))
        others[0].begin(b"theirs")
        raise FileExistsError

    monkeypatch.setattr(PartialFile, "appearing", classmethod(late))
    assert run(two_balls(tmp_path, duration_s=0.05), "--out", "mine") == 2
    assert capsys.readouterr().err.startswith("mine: already contains a run (run.mcap.partial)")
    assert others[0].partial.read_bytes() == b"theirs"
    others[0].stream.close()


def test_force_does_not_replace_a_run_in_progress(tmp_path, capsys):
    path = two_balls(tmp_path, duration_s=0.05)
    (tmp_path / "cwd" / "mine").mkdir()
    file = PartialFile(tmp_path / "cwd" / "mine" / "run.mcap")
    file.begin(b"so far")
    assert run(path, "--out", "mine", "--force") == 2
    assert "mine: another run is being written there; choose another --out" in capsys.readouterr().err
    assert file.partial.read_bytes() == b"so far"
    file.stream.close()  # as if it had been killed
    assert run(path, "--out", "mine") == 2
    assert "mine: already contains a run (run.mcap.partial)" in capsys.readouterr().err
    assert run(path, "--out", "mine", "--force") == 0


def test_a_log_that_was_completed_before_the_lock_is_not_overwritten(tmp_path, monkeypatch):
    """It was opened before and locked after another run renamed it: the lock is on the completed log of that run."""
    first = PartialFile(tmp_path / "run.mcap")
    first.begin(b"whole")
    opened = os.open

    def open_then_finish(*arguments):
        descriptor = opened(*arguments)
        if not first.stream.closed:
            first.finish()
        return descriptor

    monkeypatch.setattr(os, "open", open_then_finish)
    second = PartialFile(tmp_path / "run.mcap")
    assert second.left_bytes == 0
    second.begin(b"another")
    assert (tmp_path / "run.mcap").read_bytes() == b"whole"
    second.stream.close()


KILLED = """
import importlib, os, signal, sys, time
from ffsm_mj.cli.main import main

place, what = sys.argv[1:3]
module, _, name = place.partition(":")
owner = importlib.import_module(module)
*classes, name = name.split(".")
for part in classes:
    owner = getattr(owner, part)
original = getattr(owner, name)

def stop(*arguments, **options):
    if what == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    print("here", flush=True)
    time.sleep(60)
    return original(*arguments, **options)

setattr(owner, name, stop)
sys.exit(main(sys.argv[3:]))
"""
BEFORE = [
    "ffsm_mj.assembly.prepare:PreparedRun.assemble",
    "ffsm_mj.assembly.plant:Plant",
    "ffsm_mj.log.mcap.sink:McapSink._register",
]


@pytest.mark.long
@pytest.mark.parametrize("place", [*BEFORE, "ffsm_mj.log.run_folder:RunFolder.take"])
def test_a_start_up_that_is_killed_leaves_nothing(tmp_path, place):
    killed = python(KILLED, place, "kill", "run", two_balls(tmp_path), "--no-rerun")
    assert killed.wait(60) == -signal.SIGKILL
    assert list((tmp_path / "cwd").rglob("*")) == []
    killed.communicate()


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize(
    "place", ["ffsm_mj.log.mcap.sink:BlockWriter.continue_in", "ffsm_mj.log.run_folder:RunFolder._write_inputs"]
)
def test_a_run_that_is_killed_at_once_leaves_a_log_with_scenario_and_models(tmp_path, place):
    """It contains scenario and models, and one line reports that it has no sample."""
    killed = python(KILLED, place, "kill", "run", two_balls(tmp_path), "--no-rerun")
    assert killed.wait(60) == -signal.SIGKILL
    killed.communicate()
    (folder,) = (tmp_path / "cwd" / "logs").iterdir()
    assert b"name: scene" in (folder / "run.mcap.partial").read_bytes()
    with pytest.raises(LogError, match="ends, or is damaged, before its first sample"):
        ffsm_mj.load_run(folder)


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("place", BEFORE[:2])
def test_a_start_up_that_is_interrupted_exits_130_and_leaves_nothing(tmp_path, place, number):
    process = python(KILLED, place, "wait", "run", two_balls(tmp_path), "--no-rerun")
    assert process.stdout.readline() == "here\n"
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out, err) == (130, "", "interrupted\n")
    assert list((tmp_path / "cwd").rglob("*")) == []


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("seed", range(40))
def test_no_kill_leaves_a_folder_without_a_log(tmp_path, seed):
    """At random times from the start of Python to the middle of the run, two thirds of them before the simulation starts."""
    rng = random.Random(seed)
    command = [sys.executable, "-m", "ffsm_mj.cli.main", "run", str(two_balls(tmp_path, duration_s=200.0)), "--no-rerun"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    logs, until = tmp_path / "cwd" / "logs", time.monotonic() + 60.0
    if seed % 3:
        time.sleep(rng.uniform(0.0, 1.2))
    else:  # about when the folder appears
        while not logs.exists() and time.monotonic() < until:
            pass
        time.sleep(rng.expovariate(200.0))
    process.send_signal(rng.choice([signal.SIGKILL, signal.SIGTERM]))
    process.wait(60)
    for folder in logs.iterdir() if logs.exists() else ():
        if not folder.is_symlink():
            assert b"name: scene" in find_log(folder).read_bytes()


def test_force_removes_the_old_run_and_nothing_else(tmp_path):
    """Models of another robot, the recording and links are removed; notes, tables and targets of links are kept."""
    mine = tmp_path / "cwd" / "mine"
    assert main(["run", str(two_balls(tmp_path, duration_s=0.05)), "--out", "mine"]) == 0
    assert {"run.rrd", "mjcf/target/target.xml"} <= files(mine)
    (mine / "notes.txt").write_text("mine")
    (mine / "mjcf" / "notes.txt").write_text("mine too")
    (tmp_path / "elsewhere.json").write_text("kept")
    (mine / "summary.json").unlink()
    (mine / "summary.json").symlink_to(tmp_path / "elsewhere.json")
    (mine / "run.mcap.partial").symlink_to(tmp_path / "elsewhere.json")
    other = tmp_path / "other"
    other.mkdir()
    path = two_balls(other, duration_s=0.05)
    text = (
        path.read_text().replace('"target"', '"goal"').replace("target/target", "goal/target").replace("target/x", "goal/x")
    )
    path.write_text(text)
    assert run(path, "--out", "mine", "--force") == 0
    ours = {"run.mcap", "scenario.yaml", "summary.json", "mjcf/robot/robot.xml", "mjcf/goal/target.xml"}
    assert files(mine) == ours | {"notes.txt", "mjcf/notes.txt"}
    assert not [path for path in mine.rglob("*") if path.is_symlink()]
    assert (tmp_path / "elsewhere.json").read_text() == "kept"
    assert (mine / "notes.txt").read_text() == "mine"
    assert ffsm_mj.load_run(mine).complete


def test_force_follows_no_link_to_a_folder(tmp_path, capsys):
    path = two_balls(tmp_path, duration_s=0.05)
    assert run(path, "--out", "mine") == 0
    before = {name: (tmp_path / "cwd" / "mine" / name).read_bytes() for name in files(tmp_path / "cwd" / "mine")}
    (tmp_path / "cwd" / "link").symlink_to("mine")
    assert run(path, "--out", "link", "--force") == 2
    assert "link: is a symbolic link, which --force does not follow; give the folder itself" in capsys.readouterr().err
    models = tmp_path / "cwd" / "mine" / "mjcf"
    models.rename(tmp_path / "models")
    models.symlink_to(tmp_path / "models")
    assert run(path, "--out", "mine", "--force") == 2
    assert "mine/mjcf: is not a regular folder" in capsys.readouterr().err
    models.unlink()
    (tmp_path / "models").rename(models)
    assert {name: (tmp_path / "cwd" / "mine" / name).read_bytes() for name in files(tmp_path / "cwd" / "mine")} == before


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("scenario.yaml", "mine: contains scenario.yaml but no run, and --force replaces runs only"),
        ("mjcf/robot/robot.xml", "mine: contains mjcf/robot/robot.xml but no run, and --force replaces runs only"),
    ],
)
def test_force_replaces_runs_only(tmp_path, capsys, name, words):
    file = tmp_path / "cwd" / "mine" / name
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    for force in ([], ["--force"]):
        assert run(two_balls(tmp_path, duration_s=0.05), "--out", "mine", *force) == 2
        assert file.read_text() == "mine"
        assert files(tmp_path / "cwd" / "mine") == {name}
    assert words in capsys.readouterr().err


def test_force_refuses_a_model_that_the_old_run_did_not_write(tmp_path, capsys):
    path = two_balls(tmp_path, duration_s=0.05)
    assert run(path, "--out", "mine") == 0
    own = tmp_path / "cwd" / "mine" / "mjcf" / "robot" / "new.xml"
    own.write_text("mine")
    (tmp_path / "new.xml").write_text(ball("ball", mass=2.0, joints="x"))
    path.write_text(path.read_text().replace("robot.xml", "new.xml"))
    assert run(path, "--out", "mine", "--force") == 2
    assert (
        "mine/mjcf/robot/new.xml: does not belong to the run that --force replaces; move it away" in capsys.readouterr().err
    )
    assert own.read_text() == "mine"
    assert ffsm_mj.load_run("mine").complete


def test_force_removes_no_file_of_the_user_that_a_log_names(tmp_path):
    """A log with attachments named like files of the user: only files in the folder of models are removed."""
    assert run(two_balls(tmp_path, duration_s=0.05), "--out", "mine") == 0
    mine = tmp_path / "cwd" / "mine"
    names = {b"mjcf/target/target.xml": b"../../../../theses.txt", b"mjcf/robot/robot.xml": b"a/thesis_thesis.txt"}
    data = (mine / "run.mcap").read_bytes()
    for old, new in names.items():
        assert old in data
        data = data.replace(old, new.ljust(len(old), b"x")[: len(old)])
    (mine / "run.mcap").write_bytes(data)
    for new in names.values():
        file = mine / new.decode()
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("mine")
    (mine / "mjcf" / "target" / "target.xml").unlink()
    (mine / "mjcf" / "robot" / "robot.xml").unlink()
    assert run(two_balls(tmp_path, duration_s=0.05), "--out", "mine", "--force") == 0
    assert all((mine / new.decode()).read_text() == "mine" for new in names.values())


def test_the_summary_is_written_atomically(tmp_path, monkeypatch):
    """Written under another name and renamed, with permissions from the umask."""
    seen = []
    replace = os.replace

    def watched(source, target):
        if str(target).endswith("summary.json"):
            seen.append((os.path.exists(target), json.loads(Path(source).read_text())["outcome"]))
        replace(source, target)

    monkeypatch.setattr(os, "replace", watched)
    before = os.umask(0o027)
    try:
        ffsm_mj.run(two_balls(tmp_path, duration_s=0.05), out="mine", rerun=False)
    finally:
        os.umask(before)
    assert seen == [(False, "completed")]
    mine = tmp_path / "cwd" / "mine"
    assert {stat.S_IMODE((mine / name).stat().st_mode) for name in files(mine)} == {0o640}


def test_a_folder_of_the_name_latest_is_left_alone(tmp_path):
    latest = tmp_path / "cwd" / "logs" / "latest"
    latest.mkdir(parents=True)
    assert run(two_balls(tmp_path, duration_s=0.05)) == 0
    assert latest.is_dir()
    assert not latest.is_symlink()
    assert len(list(latest.parent.iterdir())) == 2


def test_an_unusable_folder_gives_one_line(tmp_path, capsys):
    (tmp_path / "cwd" / "file").write_text("")
    for out in ("file", "file/below", "x" * 300):
        assert run(two_balls(tmp_path, duration_s=0.05), "--out", out) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"{out}: cannot be used as a run folder (")
    assert {path.name for path in (tmp_path / "cwd").iterdir()} == {"file"}
