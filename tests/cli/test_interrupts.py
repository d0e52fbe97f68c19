"""Ctrl-C and SIGTERM at random moments: the exit code is 130, one line says so, and nothing waits for ever."""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

import ffsm_mj
from ffsm_mj.cli.exit_codes import INTERRUPTED, OK

FFSM = [sys.executable, "-P", "-m", "ffsm_mj"]
LOOP = """import os, signal, sys, ffsm_mj
for number in range(3):
    report = lambda *_: os.kill(os.getpid(), signal.SIGINT)
    print("run", number, flush=True)
    ffsm_mj.run("coasting", report=report, rerun=False, out=f"run{number}")
"""


@pytest.mark.long
def test_a_loop_over_runs_ends_at_ctrl_c(tmp_path):
    """After the log of the run under way is closed."""
    done = subprocess.run([sys.executable, "-c", LOOP], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout == "run 0\n"
    assert "KeyboardInterrupt" in done.stderr
    assert ffsm_mj.load_run(tmp_path / "run0").outcome == "interrupted"


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("seed", range(60))
def test_ctrl_c_at_a_random_moment_of_a_command(tmp_path, seed):
    """Imports included, where Python makes another exception of it."""
    rng = random.Random(seed)
    run = subprocess.Popen(
        [*FFSM, "run", "coasting", "--no-rerun", "--out", "a"], cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.PIPE
    )
    # The interpreter itself must have begun: before, nothing of ours is asked.
    time.sleep(rng.uniform(0.3, 2.0))
    run.send_signal(signal.SIGINT)
    _, complaint = run.communicate(timeout=60)
    if run.returncode == -signal.SIGINT:
        return  # before anything of ours was asked
    assert run.returncode in (INTERRUPTED, OK)
    assert b"internal_error" not in complaint
    assert b"Traceback" not in complaint


@pytest.fixture(scope="module")
def campaign(tmp_path_factory) -> Path:
    """A file of a campaign of 24 short runs."""
    folder = tmp_path_factory.mktemp("campaign")
    path = folder / "c.yaml"
    path.write_text(
        "campaign: c\nscenario: tap\noverrides: {duration_s: 0.1}\nsamples: {kind: random, n: 24, seed: 3}\n"
        "dispersions: {initial.rates.robot/stroke: {offset: {normal: {sd: 0.01}}}}\n"
    )
    return path


def rows_of(folder: Path) -> int:
    try:
        with closing(sqlite3.connect(f"file:{folder}/rows.sqlite?mode=ro", uri=True, timeout=0.01)) as base:
            return int(base.execute("select count(*) from rows").fetchone()[0])
    except sqlite3.Error:
        return 0


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("seed", range(140))
def test_a_campaign_ends_whenever_its_parent_is_told_to(campaign, tmp_path, seed):
    """SIGTERM to the parent alone: its workers are gone, the rows stay, and ``resume`` finds the rest."""
    rng = random.Random(seed)
    folder = tmp_path / "C"
    run = subprocess.Popen(
        [*FFSM, "campaign", "run", str(campaign), "--out", str(folder), "--workers", "2"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    wanted = rng.choice([0, 1, 12, 18, 22, 23, 23, 24])
    while run.poll() is None and rows_of(folder) < wanted:
        time.sleep(0.005)
    time.sleep(rng.uniform(0.0, 0.25))
    run.send_signal(rng.choice([signal.SIGTERM, signal.SIGINT]))
    try:
        _, complaint = run.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        pytest.fail("the campaign waits for ever")
    if b"init_import_site" not in complaint:  # the interpreter itself was beginning, and has a code of its own
        # The last two before anything of ours began.
        assert run.returncode in (INTERRUPTED, OK, -signal.SIGTERM, -signal.SIGINT), complaint.decode()
    deadline = time.monotonic() + 10.0
    while is_alive(run.pid) and time.monotonic() < deadline:
        time.sleep(0.05)  # they end by themselves when they see that the parent has
    assert not is_alive(run.pid)


def is_alive(group: int) -> bool:
    """Whether a group of processes has any that is no zombie."""
    table = subprocess.run(["ps", "-A", "-o", "pgid=,stat="], capture_output=True, text=True, check=True).stdout
    return any(int(pgid) == group and not stat.startswith("Z") for pgid, stat in map(str.split, table.splitlines()))
