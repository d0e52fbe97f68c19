"""What ``ffsm analyze`` says of logs that somebody changed, damaged or cut: in files whose checksums all hold, too."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.log.mcap.sink import McapSink
from ffsm_mj.log.run_folder import PartialFile
from ffsm_mj.log.scenario import compile_log
from tests.log.test_damage import chunks
from tests.scenes import two_balls


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of 4 s with its impact at 2.5 s; its samples fill several chunks."""
    folder = tmp_path_factory.mktemp("whole")
    path = two_balls(folder, duration_s=4.0, gap=2.5, log={"view_rate_hz": 5.0})
    ffsm_mj.run(path, out=folder / "out", rerun=False)
    return folder / "out"


@pytest.fixture
def run(folder):
    return ffsm_mj.load_run(folder)


def analyzed(path, capsys, *more):
    """Exit code and output."""
    code = main(["analyze", str(path), *more])
    said = capsys.readouterr()
    assert not said.err
    return code, said.out


def written(log, path):
    """A log as a whole new file with checksums of its own: first what happened, then a chunk for every 500 samples."""
    sink = McapSink(PartialFile(path).begin, compile_log(log), 5.0)
    sink.open(log.header)
    for impact in log.impacts:
        sink.event(impact)
    for first in range(0, len(log.rows), 500):
        sink.rows(log.rows[first : first + 500])
        sink.flush()
    sink.close(log.outcome)
    return path


def test_a_whole_log_is_verified(folder, capsys):
    code, out = analyzed(folder, capsys)
    assert code == 0
    assert "columns agree with states (" in out
    assert "checks pass over 4 s (4001 samples)\n\ncolumns agree" in out


def test_a_file_that_was_written_anew_is_as_good_as_the_first(run, tmp_path, capsys):
    assert analyzed(written(run.log, tmp_path / "x.mcap"), capsys)[0] == 0


@pytest.mark.long
@pytest.mark.parametrize("key", ["state.q_target_x_m", "energy.total_J", "actuators.robot_push_x_upper_N"])
def test_a_changed_number_shows_though_every_checksum_holds(run, tmp_path, capsys, key):
    rows = run.log.rows.copy()
    i = run.keys.index(key)
    rows[1234, i] = 1e-6 if np.isinf(rows[1234, i]) else rows[1234, i] + 1e-6
    path = written(replace(run.log, rows=rows), tmp_path / "x.mcap")
    code, out = analyzed(path, capsys)
    assert code == 1
    assert "COLUMNS DO NOT AGREE WITH STATES:\n" in out
    assert f"in {key} at 1.234 s" in out
    assert "damaged" not in out
    code, out = analyzed(path, capsys, "--json")
    assert code == 1
    states = json.loads(out)["states"]
    assert not states["agree"]
    assert states["samples"] == 4001


def test_dropped_samples_show_though_every_checksum_holds(run, tmp_path, capsys):
    rows = np.delete(run.log.rows, slice(1000, 1100), axis=0)
    code, out = analyzed(written(replace(run.log, rows=rows), tmp_path / "x.mcap"), capsys)
    assert code == 4
    assert "damaged: samples are missing from 0.999 to 1.1 s" in out
    assert "checks pass" in out
    assert "columns agree with states" in out


@pytest.mark.long
def test_a_law_that_is_violated_is_worse_than_a_sample_that_is_missing(run, tmp_path, capsys):
    rows = np.delete(run.log.rows, 1000, axis=0)
    rows[3000:, run.keys.index("state.v_target_x_m_s")] *= 0.99
    code, out = analyzed(written(replace(run.log, rows=rows), tmp_path / "x.mcap"), capsys)
    assert code == 1
    assert "FAILED: energy" in out


CHUNKS = {
    "removed": (lambda a, _, c: (a, c), "samples are missing from 2.999 to 3.5 s"),
    "doubled": (lambda a, b, c: (a, b, b, c), "the sample at 3 s follows the one at 3.499 s"),
    "swapped": (lambda a, b, c: (a, c, b), "the sample at 3 s follows the one at 3.999 s"),
}


@pytest.mark.long
@pytest.mark.parametrize("what", CHUNKS)
def test_chunks_that_are_not_where_they_were(run, tmp_path, capsys, what):
    """Each chunk is whole and so is its checksum: the times of the samples tell."""
    data, choose = written(run.log, tmp_path / "whole.mcap").read_bytes(), CHUNKS[what]
    places = chunks(data)[-5:-2]  # the last two hold the last sample and the outcome
    parts = [data[start:end] for start, end in places]
    between = b"".join(data[end:start] for (_, end), (start, _) in pairwise(places))  # indexes of the chunks
    rest = data[places[-1][1] :]
    (tmp_path / "x.mcap").write_bytes(data[: places[0][0]] + b"".join(choose[0](*parts)) + between + rest)
    code, out = analyzed(tmp_path / "x.mcap", capsys)
    assert code == 4
    (line,) = (line for line in out.splitlines() if line.startswith("damaged: "))
    assert choose[1] in line
    assert "all samples were read" not in line
    assert "columns agree with states" in out


def test_a_log_that_breaks_off_is_4(folder, tmp_path, capsys):
    data = (folder / "run.mcap").read_bytes()
    (tmp_path / "run.mcap.partial").write_bytes(data[: int(len(data) * 0.6)])
    code, out = analyzed(tmp_path / "run.mcap.partial", capsys)
    assert code == 4
    assert "incomplete: " in out
    assert "columns agree with states" in out


def test_without_its_models_nothing_is_verified(run, tmp_path, capsys):
    log = replace(run.log, header=replace(run.log.header, files={}))
    sink = McapSink(PartialFile(tmp_path / "x.mcap").begin, compile_log(run.log), 5.0)
    sink.open(log.header)
    sink.rows(log.rows)
    sink.close(log.outcome)
    code, out = analyzed(tmp_path / "x.mcap", capsys)
    assert code == 4
    assert "NOT VERIFIED: nothing can be recomputed" in out
    assert "columns agree" not in out


@pytest.mark.long
def test_the_worst_of_several_runs_decides(folder, run, tmp_path, capsys):
    rows = np.delete(run.log.rows, 1000, axis=0)
    gap = written(replace(run.log, rows=rows), tmp_path / "gap.mcap")
    assert main(["analyze", str(folder), str(gap)]) == 4
    assert "1 of 2 runs verified; damaged or incomplete: gap" in capsys.readouterr().out
    rows = run.log.rows.copy()
    rows[5, 1] += 1.0
    wrong = written(replace(run.log, rows=rows), tmp_path / "wrong.mcap")
    assert main(["analyze", str(folder), str(gap), str(wrong)]) == 1
    assert "1 of 3 runs verified; FAILED in wrong; damaged or incomplete: gap" in capsys.readouterr().out
