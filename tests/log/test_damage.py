"""Incomplete and damaged logs, full disks and closed pipes: readable parts are read, one line reports the rest."""

from __future__ import annotations

import json
import os
import random
import resource
import struct
import subprocess
import sys

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.cli.main import main
from ffsm_mj.errors import LogError
from tests.scenes import two_balls

CUTS, FLIPS = 15, 30
CHUNK_ROWS = 2000  # a chunk ends with the block in which it passes 1 MiB


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The bytes of a finished log of several chunks, and its run."""
    folder = tmp_path_factory.mktemp("whole")
    path = two_balls(folder, duration_s=4.0, gap=2.5, log={"view_rate_hz": 5.0})
    run = ffsm_mj.run(path, out=folder / "out", rerun=False)
    return (folder / "out" / "run.mcap").read_bytes(), run


def read(tmp_path, data):
    """The run in some bytes, or the message of the error."""
    file = tmp_path / "x.mcap"
    file.write_bytes(data)
    try:
        return ffsm_mj.load_run(file)
    except LogError as error:
        line = str(error)
    assert "\n" not in line
    assert line.startswith(f"{file}: ")
    return None


def chunks(data):
    """Start and end of each chunk of a complete file."""
    at, found = 8, []
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == 6:
            found.append((at, at + 9 + length))
        at += 9 + length
    return found


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_a_truncated_log_gives_every_chunk_before_the_cut(finished, tmp_path, seed):
    data, run = finished
    ends = [end for _, end in chunks(data)]
    rng = random.Random(seed)
    for cut in [*(rng.randrange(len(data)) for _ in range(CUTS)), *ends, len(data) - 1]:
        got = read(tmp_path, data[:cut])
        if cut < ends[0]:  # before the first chunk there is nothing to be had
            assert got is None
            continue
        assert got is not None
        np.testing.assert_array_equal(got.log.rows, run.log.rows[: len(got.time)])
        assert len(got.time) >= 1000 * (sum(end <= cut for end in ends) - 3)  # two events and the outcome end chunks early
        assert got.complete == (cut >= ends[-1])
        assert got.complete == bool(got.damage)
        assert all(check.passes for check in all_checks(got, 1e-12))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_a_flipped_byte_is_detected_and_loses_at_most_one_chunk(finished, tmp_path, seed):
    """At any position of the file: every row that is read is one that was written, and the damage is reported."""
    data, run = finished
    written = {row.tobytes() for row in run.log.rows}
    rng = random.Random(seed)
    for _ in range(FLIPS):
        bad = bytearray(data)
        at = rng.randrange(len(data))
        bad[at] ^= rng.randrange(1, 256)
        got = read(tmp_path, bytes(bad))
        if got is None:
            assert at < chunks(data)[0][1]
            continue
        assert got.damage or not got.complete
        assert all(row.tobytes() in written for row in got.log.rows)
        assert len(got.time) >= len(run.time) - CHUNK_ROWS


@pytest.mark.long(one_of=4)
@pytest.mark.parametrize("offset", [200, 3, 0, 40], ids=["content", "length", "opcode", "compression"])
def test_reading_continues_after_a_damaged_chunk(finished, tmp_path, capsys, offset):
    """The samples of the largest chunk of the first half are missing, all others are read, and ``analyze`` lists them.

    Which chunk has samples is not the same everywhere: a slow machine flushes between blocks, an event ends a chunk early.
    """
    data, run = finished
    bad, (start, _) = bytearray(data), max((c for c in chunks(data) if c[1] < len(data) / 2), key=lambda c: c[1] - c[0])
    bad[start + offset] ^= 0x55
    got = read(tmp_path, bytes(bad))
    assert got.complete
    assert 0 < len(run.time) - len(got.time) <= CHUNK_ROWS
    assert got.time[-1] == 4.0
    assert main(["analyze", str(tmp_path / "x.mcap")]) == 4
    said = capsys.readouterr()
    (line,) = (line for line in said.out.splitlines() if line.startswith("damaged: "))
    assert "bytes cannot be read; samples are missing from " in line
    assert not said.err


def test_schemas_of_a_lost_first_chunk_come_from_the_summary(finished, tmp_path):
    data, run = finished
    start, end = chunks(data)[0]
    bad = bytearray(data)
    bad[(start + end) // 2] ^= 1
    got = read(tmp_path, bytes(bad))
    assert got.name == run.name
    assert got.conservative
    assert len(got.time) > 2000


def test_an_unreadable_log_gives_one_line_and_exit_2(finished, tmp_path, capsys):
    data, _ = finished
    for bad, words in (
        (data[:100], "ends before its header"),
        (b"", "not an MCAP file"),
        (os.urandom(5000), "not an MCAP file"),
    ):
        (tmp_path / "x.mcap").write_bytes(bad)
        assert main(["analyze", str(tmp_path / "x.mcap")]) == 2
        said = capsys.readouterr()
        assert said.err.count("\n") == 1
        assert words in said.err


def run_in_process(arguments, *, file_bytes=None, **streams):
    """Run ``ffsm`` in a process with a limit on the size of its files."""

    def limit():
        if file_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes))

    # -B: bytecode cut at the limit would break every later import ("marshal data too short").
    command = [sys.executable, "-B", "-m", "ffsm_mj.cli.main", *arguments]
    return subprocess.run(command, preexec_fn=limit, text=True, stderr=subprocess.PIPE, check=False, **streams)


@pytest.mark.long
@pytest.mark.parametrize(
    ("file_bytes", "rerun"),
    [(120_000, False), (500, False), (10_000, False), (120_000, True)],
    ids=["mid-run", "inputs", "head of the log", "mid-run with Rerun"],
)
def test_a_full_disk_gives_one_line_and_exit_3(tmp_path, file_bytes, rerun):
    """Everything flushed before is readable, and its checks pass."""
    path = two_balls(tmp_path, duration_s=4.0)
    out = tmp_path / "out"
    arguments = ["run", str(path), "--out", str(out), *([] if rerun else ["--no-rerun"])]
    done = run_in_process(arguments, file_bytes=file_bytes, stdout=subprocess.PIPE)
    assert done.returncode == 3
    *others, line = done.stderr.splitlines()
    assert line.startswith("write_failed: ")
    assert line.endswith("File too large")
    assert not others or (rerun and all("ERROR" in other for other in others))  # Rerun's own
    if file_bytes == 120_000:
        got = ffsm_mj.load_run(out)
        assert len(got.time) >= 1000
        assert not got.complete
        assert all(check.passes for check in all_checks(got, 1e-12))
        assert json.loads((out / "summary.json").read_text())["outcome"] == "write_failed"


def test_checks_of_a_damaged_log_start_at_its_first_sample(tmp_path):
    """The balance starts at t = 0: its values at the first readable sample are no failure, and the gap is reported."""
    ffsm_mj.run(two_balls(tmp_path, duration_s=3.0), out=tmp_path / "out", rerun=False)
    log = tmp_path / "out" / "run.mcap"
    data = bytearray(log.read_bytes())
    whole = ffsm_mj.load_run(log)
    chunk = next(s for s in range(len(data)) if data[s] == 6 and data[s + 37 : s + 45] == b"\x04\x00\x00\x00zstd")
    damaged = None
    for _ in range(20):  # the chunk with the first samples: an event behind them closes it
        length = int.from_bytes(data[chunk + 1 : chunk + 9], "little")
        copy = data.copy()
        copy[chunk + length // 2 + 9] ^= 0xFF
        log.write_bytes(copy)
        run = ffsm_mj.load_run(log)
        if len(run.time) and run.time[0] > 0.0:
            damaged = run
            break
        chunk += 9 + length
        chunk = next(s for s in range(chunk, len(data)) if data[s] == 6 and data[s + 37 : s + 45] == b"\x04\x00\x00\x00zstd")
    assert damaged is not None
    assert damaged.time[0] > 0.0
    assert f"samples are missing from 0 to {damaged.time[0]:g} s" in damaged.damage
    assert all(check.passes for check in all_checks(damaged, 1e-12))
    assert len(damaged.time) < len(whole.time)


def test_other_commands_report_damage_too(finished, tmp_path, capsys):
    """A table of a log with a gap is written, with one line about the gap."""
    data, _ = finished
    start, _ = chunks(data)[0]
    file = tmp_path / "hole.mcap"
    file.write_bytes(data[: start + 200] + bytes(100) + data[start + 300 :])
    assert main(["export", str(file), "--csv", "--table", "impacts"]) == 4
    assert f"{file}: damaged: " in capsys.readouterr().err
    assert main(["analyze", str(file)]) == 4
    out = capsys.readouterr().out
    assert "DAMAGED LOG, see the end" in out
    assert "in the readable part" in out
