"""A series of cases on all processors."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.hostile.worker import Result


def parts(first: int, count: int) -> list[range]:
    """Numbers of the cases of a series in nine parts, of which a plain run of the tests takes the first, the shortest."""
    size = -(-(count - first) // 8)
    return [range(first), *(range(start, min(start + size, count)) for start in range(first, count, size))]


def run_series(seed: int, first: int, count: int, folder: Path, workers: int | None = None) -> list[Result]:
    """Run cases ``first`` to ``first + count - 1`` of a seed, in so many processes; None: one per processor.

    Raises:
        RuntimeError: A worker broke down; what it said is the message.
    """
    workers = min(count, workers or os.cpu_count() or 1)
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    running = [
        subprocess.Popen(
            [sys.executable, "-m", "tests.hostile.worker", *map(str, (seed, first + i, first + count, workers, folder))],
            env=environment,
            cwd=Path(__file__).parents[2],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for i in range(workers)
    ]
    said = [worker.communicate()[1] for worker in running]
    lines = [line for i in range(workers) for line in (folder / f"{first + i}.jsonl").read_text().splitlines()]
    results = [Result(**json.loads(line)) for line in lines]
    if len(results) != count:
        raise RuntimeError(f"{len(results)} of {count} cases were run:\n" + "\n".join(said))
    return sorted(results, key=lambda result: result.number)


def complaints(results: Sequence[Result]) -> list[str]:
    """What is wrong with the cases, each with what it said last."""
    return [f"case {r.number} ({r.kind}): {r.complaint}\n{r.stderr[-600:]}" for r in results if r.complaint]


def takes_some(results: Sequence[Result], kind: str) -> bool:
    """Whether of the cases of a kind some are taken and some refused: otherwise they would show nothing."""
    refused = [r.codes[-1] == 2 for r in results if r.kind.startswith(kind)]
    return any(refused) and not all(refused)
