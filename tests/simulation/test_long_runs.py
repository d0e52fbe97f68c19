"""Runs of any length: flat memory while they are written and read, the same numbers from memory and from the file."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pyarrow.parquet
import pytest

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.errors import LogError
from ffsm_mj.log.mcap import reader
from ffsm_mj.log.mcap.reader import StoredRows
from ffsm_mj.log.mcap.salvage import LogFile
from ffsm_mj.report import export
from ffsm_mj.report.animation import write_animation
from ffsm_mj.report.plots import figures, thinning
from ffsm_mj.verification.checks import CheckAccumulator
from ffsm_mj.verification.residuals import BalanceColumns, norms
from tests.scenes import two_balls


@pytest.fixture
def large(monkeypatch):
    """No log is small."""
    monkeypatch.setattr(reader, "KEPT_BYTES", 0)


@pytest.mark.long
@pytest.mark.usefixtures("large")
def test_memory_and_file_give_the_same_numbers(tmp_path):
    """Bit by bit, whether the rows were kept, went past in the run, or are read back block by block."""
    settings = {"duration_s": 8.0}
    kept = ffsm_mj.run("baseline", settings)
    written = ffsm_mj.run("baseline", settings, out=tmp_path / "out", rerun=False)
    read = ffsm_mj.load_run(tmp_path / "out")
    assert isinstance(kept.log.rows, np.ndarray)
    assert isinstance(written.log.rows, StoredRows)
    assert isinstance(read.log.rows, StoredRows)
    assert written.path == read.path == tmp_path / "out" / "run.mcap"
    assert all_checks(kept) == all_checks(written) == all_checks(read) == all_checks(Run(read.log))
    assert ffsm_mj.summary(written) == ffsm_mj.summary(read) == json.loads((tmp_path / "out" / "summary.json").read_text())
    differing = {"wall_s", "real_time_factor", "law_wall_s_per_tick"}
    summaries = [{k: v for k, v in ffsm_mj.summary(run).items() if k not in differing} for run in (kept, written)]
    assert summaries[0] == summaries[1]
    worst = max(p["reports"].get("worst_riccati_residual", 0.0) for p in summaries[0]["controller"]["phases"])
    assert worst == np.nanmax(kept["controller.osdre_riccati_residual"])
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
    for beyond in (rows.shape[1], -rows.shape[1] - 1):
        with pytest.raises(IndexError, match="out of range"):
            rows[:, beyond]


@pytest.mark.usefixtures("large")
def test_a_row_is_read_from_its_chunk_alone(tmp_path, monkeypatch):
    ffsm_mj.run(two_balls(tmp_path, duration_s=4.0), out=tmp_path / "out", rerun=False)
    rows = ffsm_mj.load_run(tmp_path / "out").log.rows
    read, content = [], LogFile.content
    monkeypatch.setattr(LogFile, "content", lambda self, chunk: read.append(chunk) or content(self, chunk))
    last = rows[-1]
    assert read == [rows.batches[-1].chunk]
    np.testing.assert_array_equal(last, rows[:][-1])
    assert len(read) > 3


@pytest.mark.usefixtures("large")
def test_a_log_that_was_replaced_is_not_taken_for_the_run(tmp_path):
    path = two_balls(tmp_path)
    run = ffsm_mj.run(path, out=tmp_path / "out", rerun=False)
    ffsm_mj.run(path, {"duration_s": 0.5}, out=tmp_path / "out", rerun=False, force=True)
    with pytest.raises(LogError, match="has changed since the run was read"):
        run.time  # noqa: B018


def test_a_thinned_run_keeps_what_stands_out(baseline, monkeypatch):
    """Least and greatest of every column in every slice, of tip error and residual norms too; rows at events."""
    assert thinning.thinned(baseline) is baseline
    monkeypatch.setattr(thinning, "KEPT_BYTES", 0)
    monkeypatch.setattr(thinning, "_SLICES", 20)
    times = [1.2345, 17.0, 29.9999, 30.0]
    thin = thinning.thinned(baseline, times)
    assert len(thin.time) < len(baseline.time) / 5
    assert np.all(np.diff(thin.time) > 0.0)
    place = np.searchsorted(baseline.time, thin.time)
    np.testing.assert_array_equal(thin.log.rows, baseline.log.rows[place])
    edges = np.arange(0, len(baseline.time), -(-len(baseline.time) // 20))
    of_slice = np.searchsorted(edges, place, side="right")
    curves = {key: (baseline[key], thin[key]) for key in baseline.keys}
    curves["tip"] = baseline.tip_error(), thin.tip_error()
    for subsystem in ("total", "robot"):
        accounts = BalanceColumns(baseline.log.header.layout, baseline.log.header.metadata, subsystem)
        start = accounts.momentum(baseline.log.rows[:1])
        curves[subsystem] = tuple(norms((accounts.momentum(run.log.rows) - start)[:, 3:]) for run in (baseline, thin))
    for i, (start, stop) in enumerate(zip(edges, [*edges[1:], len(baseline.time)], strict=True), 1):
        for whole, kept in curves.values():
            part = whole[start:stop]
            if np.isfinite(part).any():
                assert np.nanmin(kept[of_slice == i]) == np.nanmin(part)
                assert np.nanmax(kept[of_slice == i]) == np.nanmax(part)
    hit = int(np.searchsorted(baseline.time, baseline.impacts[0].time_s))
    assert {hit - 1, hit, *np.searchsorted(baseline.time, np.array(times) - 1e-9)} <= set(place.tolist())
    assert all_checks(thin) == all_checks(baseline)
    assert ffsm_mj.summary(thin) == ffsm_mj.summary(baseline)


@pytest.mark.long
def test_figures_and_films_of_a_long_run_are_drawn_from_the_thinned_one(baseline, monkeypatch, tmp_path):
    names = set(figures(baseline, ("tip", "conservation", "motion")))
    monkeypatch.setattr(thinning, "KEPT_BYTES", 0)
    monkeypatch.setattr(thinning, "_SLICES", 100)
    drawn = figures(baseline, ("tip", "conservation", "motion"))
    assert set(drawn) == names
    (error, *_) = drawn["tip"].axes[0].get_lines()
    assert error.get_ydata().min() == baseline.tip_error().min()
    assert error.get_ydata()[-1] == baseline.tip_error()[-1]
    write_animation(baseline, tmp_path / "film.gif", speed=30.0, frames_per_second=4.0)
    assert (tmp_path / "film.gif").stat().st_size > 1000


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_long_run_is_exported_in_parts(tmp_path, monkeypatch, form):
    ffsm_mj.run(two_balls(tmp_path, duration_s=3.0), out=tmp_path / "out", rerun=False)
    run = ffsm_mj.load_run(tmp_path / "out")
    assert export.write_table(run, "samples", tmp_path / f"whole.{form}", form) == f"3001 rows of {len(run.keys)} columns"
    monkeypatch.setattr(reader, "KEPT_BYTES", 0)
    monkeypatch.setattr(export, "_ROWS_AT_ONCE", 700)
    export.write_table(ffsm_mj.load_run(tmp_path / "out"), "samples", tmp_path / f"parts.{form}", form)
    if form == "csv":
        assert (tmp_path / "parts.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    else:
        parts, whole = (pyarrow.parquet.ParquetFile(tmp_path / f"{name}.parquet") for name in ("parts", "whole"))
        assert parts.num_row_groups > 1
        assert parts.schema_arrow.equals(whole.schema_arrow, check_metadata=True)
        assert parts.read().to_pandas().equals(whole.read().to_pandas())  # equal where both are NaN


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize(("duration_s", "kept_MiB"), [(6, 4), (110, 64), (400, 64), (3000, 64)])
def test_a_long_baseline_holds_in_little_memory_and_a_leak_is_found(tmp_path, duration_s, kept_MiB):
    """In 400 s L_z drifts by 7e-9 and the base by 47 m; in 3000 s by 5e-7 and 310 m. 1e-7 leaked near the end are found.

    A run is long whose rows are more than 64 MiB; the shortest is so where fewer are kept.
    """
    out = str(tmp_path / "out")
    run = f"ffsm_mj.run('baseline', {{'duration_s': {duration_s}.0}}, out={out!r}, rerun=False)"
    assert peak_MB(run, kept_MiB) < 300
    arguments = ["analyze", out, "--plots", str(tmp_path / "figures")]
    assert peak_MB(f"from ffsm_mj.cli.main import main\nassert main({arguments!r}) == 0", kept_MiB) < 1000
    log = ffsm_mj.load_run(out).log
    assert 8 * log.rows.shape[0] * log.rows.shape[1] > kept_MiB << 20
    sound, leaking = (CheckAccumulator(log.header.layout, log.header.metadata) for _ in range(2))
    for block in log.blocks():
        sound.rows(block)
        block[block[:, 0] > duration_s - 5.0, log.header.layout.index["momentum.robot_L_z_N_m_s"]] += 1e-7
        leaking.rows(block)
    assert all(check.passes for check in sound.checks(log.impacts))
    broken = {(check.name, check.subsystem) for check in leaking.checks(log.impacts) if not check.passes}
    assert ("angular momentum", "robot") in broken


# Not ru_maxrss: a child begins with that of its parent.
PEAK = """
import ffsm_mj
from ffsm_mj.log.mcap import reader
reader.KEPT_BYTES = {kept_bytes}  # before others import it
{code}
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


def peak_MB(code: str, kept_MiB: int = 64) -> float:
    """Peak memory of a process of its own, in which a log of so many MiB is small."""
    text = PEAK.format(code=code, kept_bytes=kept_MiB << 20)
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    return int(done.stdout.splitlines()[-1]) / 1024


@pytest.mark.long
def test_memory_is_flat_while_a_run_is_written_and_read(tmp_path):
    """Two balls at 1 kHz, 10 s and 60 s: rows of 60 s are 50 MB. What grows is the index, 1 kB per chunk."""
    path = two_balls(tmp_path, gap=500.0)
    peaks = {}
    for duration in (10, 60):
        out = str(tmp_path / f"out{duration}")
        written = peak_MB(f"ffsm_mj.run({str(path)!r}, {{'duration_s': {duration}.0}}, out={out!r}, rerun=False)", 4)
        code = f"run = ffsm_mj.load_run({out!r}); assert all(x.passes for x in run.checks()); ffsm_mj.summary(run); run.time"
        read = peak_MB(code, 4)
        peaks[duration] = written, read
    for short, long in zip(peaks[10], peaks[60], strict=True):
        assert long < short + 20.0
