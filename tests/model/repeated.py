"""Runs that need nothing but their folder."""

from __future__ import annotations

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.log.scenario import compile_log


def repeated(path, out, *gone, overrides=()):
    """A run and the system of its log; without the files ``gone`` its folder gives the same rows again, bit by bit."""
    run = ffsm_mj.run(path, overrides, out=out, rerun=False)
    for each in gone:
        each.rename(each.with_name(f"{each.name} gone"))
    again = ffsm_mj.run(out / "scenario.yaml", out=out.with_name("again"), rerun=False)
    assert again.log.rows[:].tobytes() == run.log.rows[:].tobytes()
    assert again.log.header.files == run.log.header.files
    assert main(["analyze", str(out.with_name("again"))]) == main(["analyze", str(out)]) == 0
    return run, compile_log(ffsm_mj.load_run(out).log)
