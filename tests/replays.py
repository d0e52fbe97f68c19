"""The log of a run says what its states say: a replay of it, for a seeded tenth of the tests and with ``--long`` for all.

A replay takes as long as its run, and most runs of the suite are replayed for good measure only.
Tests of replays, and of logs that are wrong on purpose, call :func:`ffsm_mj.replay.replay_log` themselves.
"""

from __future__ import annotations

import os
from zlib import crc32

from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.replay import replay_log
from tests import long_share

_SEED = 34
_ONE_OF = 10


def assert_replayed(run, *, records=True):
    """The log agrees with its states, and every check computed from them passes.

    Args:
        run: A run.
        records: Whether records of impacts are compared too.
    """
    if not _is_taken(os.environ["PYTEST_CURRENT_TEST"]):
        return
    again = replay_log(run.log)
    assert not again.obstacle
    assert all(worst.passes for name, worst in again.worst.items() if records or name != "impacts"), again.worst
    assert again.agrees or not records
    assert [check for check in again.checks() if not check.passes] == []


def assert_passes(run):
    """It ran to its end, and every check passes."""
    assert run.outcome == "completed", run.message
    assert [check for check in all_checks(run) if not check.passes] == []


def proved(run, *, records=True):
    """A run that ran to its end, whose every check passes, and whose log agrees with its states."""
    assert_passes(run)
    assert_replayed(run, records=records)
    return run


def _is_taken(current):
    """Whether runs of a test are replayed: always in a fixture, which belongs to several."""
    test, _, stage = current.rpartition(" ")
    return long_share.every_case or stage == "(setup)" or crc32(f"{_SEED} {test}".encode()) % _ONE_OF == 0
