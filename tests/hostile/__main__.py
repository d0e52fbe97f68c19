"""``python -m tests.hostile``: a series of cases by hand; one case again with ``--only``, its files kept with ``--keep``."""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.hostile.drawing import drawn
from tests.hostile.series import run_series
from tests.hostile.strangers import STRANGERS
from tests.hostile.worker import logs_of_runs, run_case


def main() -> int:
    """Run cases and print what went wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__)
    parser.add_argument("--cases", type=int, default=1500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, help="run this case alone and print all that it says")
    parser.add_argument("--keep", type=Path, help="folder for the files of --only")
    parser.add_argument("--json", type=Path, help="write every result there, a line each")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="ffsm-hostile-") as folder:
        if options.only is not None:
            hostile = drawn(options.seed, options.only, logs_of_runs(Path(folder), with_campaign=options.seed == STRANGERS))
            place = options.keep or Path(folder) / "case"
            with os.fdopen(os.dup(1), "w") as shown:  # a case redirects the output of the process
                print(*hostile.commands, run_case(hostile, options.only, place.resolve()), sep="\n", file=shown)
            return 0
        started = time.perf_counter()
        results = run_series(options.seed, options.first, options.cases, Path(folder))
    wall = time.perf_counter() - started
    if options.json:
        options.json.write_text("".join(json.dumps(result.__dict__) + "\n" for result in results))
    bad = [result for result in results if result.complaint]
    for result in bad:
        print(f"--- {result.number} ({result.kind}): {result.complaint}\n{result.stderr[-1500:]}")
    print(f"{len(results)} cases in {wall:.0f} s, slowest {max(r.wall_s for r in results):.1f} s; {len(bad)} bad")
    for kind, count in sorted(Counter(result.kind for result in results).items()):
        codes = Counter(result.codes[-1] for result in results if result.kind == kind)
        print(f"  {kind}: {count}, exit codes {dict(sorted(codes.items()))}")
    return int(bool(bad))


if __name__ == "__main__":
    raise SystemExit(main())
