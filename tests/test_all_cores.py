"""Workers that are ended while one of them is sending its result: what wants them goes on and does not wait for the rest."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest

from ffsm_mj.all_cores import on_all_cores
from ffsm_mj.experiments import executors

ROOT = Path(__file__).parents[1]


def sent(marker: Path | None) -> bytes:
    """A result; with a marker, half of it is sent once it is wanted, then the marker stands and nothing more happens.

    Sooner it would hold the lock of the results, and the other result, at which the end comes, would never arrive.
    """

    def half(connection: Any, data: memoryview) -> None:
        os.write(connection.fileno(), data[: len(data) // 2])
        assert marker
        marker.touch()
        time.sleep(3600)

    if marker:
        wait_for(wanted(marker))
        Connection._send = half  # type: ignore[attr-defined]
    return bytes(1000)


def wanted(marker: Path) -> Path:
    return marker.with_suffix(".wanted")


def wait_for(path: Path) -> None:
    while not path.exists():
        time.sleep(0.01)


def end(marker: Path) -> None:
    wanted(marker).touch()
    wait_for(marker)
    raise KeyboardInterrupt


def end_all_cores(marker: Path) -> None:
    on_all_cores(sent, [None, marker], lambda done, _: end(marker) if done else None)


def end_campaign_workers(marker: Path) -> None:
    with executors.Processes(2) as pool:
        pool.submit(sent, marker)
        end(marker)


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("ends", [end_all_cores, end_campaign_workers])
def test_a_worker_in_the_middle_of_its_result_is_not_waited_for(tmp_path, ends):
    """In a process of its own, which a failure would stop for ever."""
    script = (
        f"from pathlib import Path; from tests.test_all_cores import *; {ends.__name__}(Path({str(tmp_path / 'half')!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        timeout=60,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert done.stderr.endswith("KeyboardInterrupt\n")
