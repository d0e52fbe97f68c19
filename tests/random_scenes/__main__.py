"""Run the scenes of a range of seeds and group what differs by cause.

``uv run --group dev python -m tests.random_scenes 0 300``
"""

from __future__ import annotations

import argparse
import time
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from tests.random_scenes.drawing import draw
from tests.random_scenes.judge import Verdict, judged


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.random_scenes", description=__doc__)
    parser.add_argument("first", type=int, help="first seed")
    parser.add_argument("end", type=int, nargs="?", help="seed after the last one; default: the first alone")
    parser.add_argument("--jobs", type=int, default=1, help="processes; default 1")
    parser.add_argument("--time-out", type=float, default=120.0, metavar="S", help="wall time of a seed; default 120 s")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the scenes to FOLDER/SEED and run nothing")
    options = parser.parse_args()
    seeds = range(options.first, options.first + 1 if options.end is None else options.end)
    if options.write:
        for seed in seeds:
            folder = options.write / str(seed)
            folder.mkdir(parents=True, exist_ok=True)
            print(draw(seed, folder))
        return 0
    with ProcessPoolExecutor(options.jobs) as pool:
        verdicts = []
        start = time.monotonic()
        for verdict in pool.map(partial(judged, limit_s=options.time_out), seeds):
            verdicts.append(verdict)
            if verdict.differences or verdict.end != "completed":
                print(verdict, flush=True)
    print(f"\n{len(verdicts)} seeds in {time.monotonic() - start:.0f} s: {dict(Counter(v.end for v in verdicts))}")
    worst = sorted(verdicts, key=lambda verdict: -verdict.cost)[:3]
    print("integrations over their bound: " + ", ".join(f"{verdict.cost:.2f} (seed {verdict.seed})" for verdict in worst))
    return _groups(verdicts)


def _groups(verdicts: list[Verdict]) -> int:
    groups = defaultdict(list)
    for verdict in verdicts:
        if verdict.differences or verdict.end != "completed":
            groups["differs" if verdict.differences else "ends early", verdict.cause].append(verdict.seed)
    for (kind, cause), members in sorted(groups.items(), key=lambda item: (item[0][0], -len(item[1]))):
        print(f"{kind}, {len(members)}: {cause}\n    seeds {' '.join(map(str, members))}")
    return int(any(verdict.differences for verdict in verdicts))


if __name__ == "__main__":
    raise SystemExit(main())
