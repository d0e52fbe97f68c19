"""Random damage of logs of all shipped scenarios: it is reported as damage, and never as a failing check or as none.

A plain run takes 4 damages of two short logs, and 8 of the 2000 that ``--long`` takes of logs of all shipped scenarios.
"""

from __future__ import annotations

import random
import re
from pathlib import Path

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run import load_run
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.analyze import _judge, _tolerance
from ffsm_mj.cli.exit_codes import BAD_INPUT, DAMAGED
from ffsm_mj.errors import FfsmError
from ffsm_mj.replay import replay_log
from ffsm_mj.report.verification_report import verification
from ffsm_mj.scenario.shipped import scenario_names
from ffsm_mj.verification.truncation import ExplainedChecks
from tests import long_share

LONG_S = 9.0
"""Logs of longer runs are cut short, after the impact of the paper's scenario."""
PERIOD_S = 0.01
"""Control periods of runs of a second and more are longer, so that logs have fewer rows."""
CHUNK = re.compile(rb"\x04\x00\x00\x00zstd")
AT = 9 + 8 + 8 + 8 + 4  # of this mark in the record of a chunk
KINDS = ("cut", "cut", "chunk", "chunk", "flip", "flips", "zeros", "index")


def damaged(rng: random.Random, whole: bytes) -> bytes:
    """A log that a full disk or a kill cut off, with a chunk lost, or with bits flipped in data, index or footer."""
    kind, data = rng.choice(KINDS), bytearray(whole)
    if kind == "cut":
        return whole[: rng.randrange(200, len(whole))]
    if kind == "chunk":
        start = rng.choice([found.start() - AT for found in CHUNK.finditer(whole)])
        data[start + 60 : start + 100] = bytes(40)
        return bytes(data)
    if kind == "zeros":
        start = rng.randrange(len(data) - 100)
        data[start : start + 40] = bytes(40)
        return bytes(data)
    last = min(3000, len(data) - 1) if kind == "index" else len(data) - 1
    for _ in range(4 if kind == "flips" else 1):
        data[len(data) - 1 - rng.randrange(last)] ^= 1 << rng.randrange(8)
    return bytes(data)


def judged(path: Path) -> tuple[int, str]:
    """Exit code of ``ffsm analyze``, and what it prints."""
    try:
        run = load_run(path)
    except FfsmError as error:
        return BAD_INPUT, str(error)
    if not len(run.log.rows):
        return BAD_INPUT, ""
    with np.errstate(all="ignore"):  # as the command: what is not finite fails its check
        again = replay_log(run.log)
        checks = again.checks(_tolerance([]))
        return _judge(run, again, checks), verification(run, again, ExplainedChecks(checks), _tolerance([]))


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Bytes of the log of a scenario of a duration; each is run once."""
    known: dict[tuple[str, float], bytes] = {}

    def log(name: str, duration_s: float) -> bytes:
        if (name, duration_s) not in known:
            folder = tmp_path_factory.mktemp("log") / name
            # What is to be reached at the end of a scenario is not reached by one that is cut short.
            period_s = float(prepare(name).scenario.control_period_s)
            if duration_s >= 1.0:
                period_s *= max(round(PERIOD_S / period_s), 1)
            cut = {"duration_s": period_s * round(duration_s / period_s), "control_period_s": period_s, "terminal": None}
            ffsm_mj.run(name, cut, out=folder, rerun=False)
            known[name, duration_s] = (folder / "run.mcap").read_bytes()
        return known[name, duration_s]

    return log


def complaints(whole: bytes, seeds: range, folder: Path) -> list[str]:
    found = []
    for seed in seeds:
        path = folder / f"{seed}.mcap"
        data = damaged(random.Random(seed), whole)
        if data == whole:
            continue
        path.write_bytes(data)
        code, text = judged(path)
        if code not in (DAMAGED, BAD_INPUT) or "FAILED" in text or "DO NOT AGREE" in text:
            found.append(f"seed {seed}: exit {code}: {text[-400:]}")
        path.unlink()
    return found


@pytest.mark.parametrize(("name", "duration_s"), [("squeeze", 0.3), ("tap", 0.4)])
def test_damage_is_damage(logs, name, duration_s, tmp_path):
    assert complaints(logs(name, duration_s), range(15 if long_share.every_case else 2), tmp_path) == []


PARTS = [(name, part) for name in scenario_names() for part in range(25)]


@pytest.mark.long(one_of=300)
@pytest.mark.parametrize(("name", "part"), PARTS)
def test_damage_of_shipped_scenarios_is_damage(logs, name, part, tmp_path):
    size = -(-2000 // len(PARTS))
    duration_s = min(LONG_S, prepare(name).scenario.duration_s)
    assert complaints(logs(name, duration_s), range(part * size, (part + 1) * size), tmp_path) == []


def test_samples_after_the_damage_are_used(logs, tmp_path):
    """A chunk with rows is lost: what follows is read, replayed and checked."""
    whole = logs("squeeze", 0.3)
    (tmp_path / "whole.mcap").write_bytes(whole)
    count = len(load_run(tmp_path / "whole.mcap").log.rows)
    starts = [found.start() - AT for found in CHUNK.finditer(whole)]
    for start in starts:
        data = bytearray(whole)
        data[start + 60 : start + 100] = bytes(40)
        (tmp_path / "log.mcap").write_bytes(data)
        log = load_run(tmp_path / "log.mcap").log
        if log.lost and log.lost[0][0] > 0.1 and len(log.rows) < count and log.rows[-1, log.header.layout.time] > 0.299:
            break
    (start_s, end_s), *_ = log.lost
    times = log.column("state.time_s")
    assert times[times < end_s - 1e-8].max() <= start_s + 1e-8
    assert times[-1] == pytest.approx(0.3)
    assert replay_log(log).samples == len(log.rows)
