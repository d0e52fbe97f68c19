"""Runs of any length: flat memory while they are written and read, the same numbers from memory and from the file."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis import Run
from ffsm_mj.errors import LogError
from ffsm_mj.log import stored_rows
from ffsm_mj.log.stored_rows import StoredRows
from tests.scenes import two_balls


@pytest.fixture
def large(monkeypatch):
    """No log is small."""
    monkeypatch.setattr(stored_rows, "KEPT_BYTES", 0)


@pytest.mark.usefixtures("large")
def test_memory_and_file_give_the_same_numbers(tmp_path):
    """Bit by bit, whether the rows were kept, went past in the run, or are read back block by block."""
    settings = {"duration_s": 12.0}
    kept = ffsm_mj.run("baseline", settings)
    written = ffsm_mj.run("baseline", settings, out=tmp_path / "out", rerun=False)
    read = ffsm_mj.load_run(tmp_path / "out")
    assert isinstance(kept.log.rows, np.ndarray)
    assert isinstance(written.log.rows, StoredRows)
    assert isinstance(read.log.rows, StoredRows)
    assert written.path == read.path == tmp_path / "out" / "run.mcap"
    assert kept.laws() == written.laws() == read.laws() == Run(read.log).laws()
    assert written.summary() == read.summary() == json.loads((tmp_path / "out" / "summary.json").read_text())
    differing = {"wall_s", "real_time_factor"}
    summaries = [{k: v for k, v in run.summary().items() if k not in differing} for run in (kept, written)]
    assert summaries[0] == summaries[1]
    assert summaries[0]["controller"]["worst_riccati_residual"] == np.nanmax(kept["controller.osdre_riccati_residual"])
    for run in (written, read):
        np.testing.assert_array_equal(run.log.rows, kept.log.rows)
        np.testing.assert_array_equal(np.concatenate(list(run.log.blocks())), kept.log.rows)
        for key in kept.keys:
            np.testing.assert_array_equal(run[key], kept[key])
        np.testing.assert_array_equal(run.momentum("robot"), kept.momentum("robot"))
        np.testing.assert_array_equal(run.tip_error(), kept.tip_error())
        np.testing.assert_array_equal(run.qpos, kept.qpos)
    assert ffsm_mj.compare(kept, read).same


KEYS = [0, -1, 1234, slice(100, 3000, 7), slice(None, None, -500), [5, 2999, 17, 17], np.arange(4001) % 1000 == 0]
KEYS += [
    (slice(None), 3),
    (-1, 0),
    (slice(10, 20), [1, 2]),
    (slice(None), slice(2, 5)),
    (np.array([4000, 1, 2]), 7),
    ([2, 1], -1),
]


@pytest.mark.usefixtures("large")
@pytest.mark.parametrize("key", KEYS, ids=str)
def test_rows_on_disk_are_indexed_like_an_array(tmp_path_factory, key):
    folder = tmp_path_factory.getbasetemp() / "indexed"
    if not folder.exists():
        folder.mkdir()
        ffsm_mj.run(two_balls(folder, duration_s=4.0), out=folder / "out", rerun=False)
    rows = ffsm_mj.load_run(folder / "out").log.rows
    whole = rows.copy()
    assert rows.shape == whole.shape == (4001, whole.shape[1])
    np.testing.assert_array_equal(rows[key], whole[key])


@pytest.mark.usefixtures("large")
def test_a_log_that_was_replaced_is_not_taken_for_the_run(tmp_path):
    path = two_balls(tmp_path)
    run = ffsm_mj.run(path, out=tmp_path / "out", rerun=False)
    ffsm_mj.run(path, {"duration_s": 0.5}, out=tmp_path / "out", rerun=False, force=True)
    with pytest.raises(LogError, match="is not what it was when the run was read"):
        run.time  # noqa: B018


PEAK = """
import resource, sys
import ffsm_mj
{code}
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def peak_MB(code: str) -> float:
    """Peak memory of a process of its own."""
    done = subprocess.run([sys.executable, "-c", PEAK.format(code=code)], capture_output=True, text=True, check=True)
    return int(done.stdout.splitlines()[-1]) / 1024


def test_memory_is_flat_while_a_run_is_written_and_read(tmp_path):
    """Two balls at 1 kHz, 20 s and 200 s: rows of 200 s are 170 MB. What grows is the index, 1 kB per chunk."""
    path = two_balls(tmp_path, gap=500.0)
    peaks = {}
    for duration in (20, 200):
        out = str(tmp_path / f"out{duration}")
        written = peak_MB(f"ffsm_mj.run({str(path)!r}, {{'duration_s': {duration}.0}}, out={out!r}, rerun=False)")
        read = peak_MB(f"run = ffsm_mj.load_run({out!r}); assert all(x.holds for x in run.laws()); run.summary(); run.time")
        peaks[duration] = written, read
    for short, long in zip(peaks[20], peaks[200], strict=True):
        assert long < short + 20.0
