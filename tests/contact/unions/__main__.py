"""Run the random scenes of some seeds: ``uv run --group dev python -m tests.contact.unions 0 300``.

``--write`` writes one, to be run by hand.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tests.contact.unions.drawing import draw
from tests.contact.unions.judge import Verdict, judge


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.contact.unions", description=__doc__)
    parser.add_argument("first", type=int, help="first seed")
    parser.add_argument("end", type=int, nargs="?", help="seed after the last one; default: the first alone")
    parser.add_argument("--jobs", type=int, default=1, help="processes; default 1")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the scenes to FOLDER/SEED and run nothing")
    options = parser.parse_args()
    seeds = range(options.first, options.first + 1 if options.end is None else options.end)
    if options.write:
        for seed in seeds:
            drawn, folder = draw(seed), options.write / str(seed)
            folder.mkdir(parents=True, exist_ok=True)
            print(drawn.name, drawn.on_whole(folder / "whole"), drawn.on_pieces(folder / "pieces"), sep="\n  ")
            drawn.on_other_pieces(folder / "other")
        return 0
    start, failed = time.monotonic(), 0
    with ProcessPoolExecutor(options.jobs) as pool:
        for verdict in pool.map(judged, seeds):
            failed += bool(verdict.faults)
            if verdict.faults or verdict.of_whole:
                print(verdict, flush=True)
    print(f"\n{failed} of {len(seeds)} seeds fail, in {time.monotonic() - start:.0f} s")
    return int(failed > 0)


def judged(seed: int) -> Verdict:
    """The verdict on a seed; an exception is a fault of it."""
    try:
        return judge(seed)
    except Exception as error:  # noqa: BLE001 (whatever the program raises is what this looks for)
        return Verdict(draw(seed).name, ["raised: " + " <- ".join(_places(error))])


def _places(error: Exception) -> Iterator[str]:
    """The exception and the last places it passed, the innermost first."""
    yield f"{type(error).__name__}: {error}"
    at, places = error.__traceback__, []
    while at is not None:
        places.append(f"{Path(at.tb_frame.f_code.co_filename).name}:{at.tb_lineno}")
        at = at.tb_next
    yield from places[:-4:-1]


if __name__ == "__main__":
    raise SystemExit(main())
