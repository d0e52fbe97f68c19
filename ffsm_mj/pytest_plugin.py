"""Fixtures for tests on logged data. pytest finds this module by itself wherever ffsm-mj is installed.

::

    from ffsm_mj.pytest_plugin import assert_conserved

    def test_the_hit(ffsm_run):
        run = ffsm_run("baseline", {"duration_s": 9.0})
        assert_conserved(run)
        assert run.impacts[0].impulse_N_s == pytest.approx(1.2224, abs=5e-4)

Nothing is imported here that costs: every test run of everybody who has ffsm-mj installed imports this module.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import pytest

if TYPE_CHECKING:
    from ffsm_mj.analysis.run import Run
    from ffsm_mj.scenario.overrides import Overrides
    from ffsm_mj.verification.checks import Tolerance


class RunFactory(Protocol):
    """What the fixture ``ffsm_run`` is."""

    def __call__(self, source: str | Path, overrides: Overrides = (), *, rerun: bool = False) -> Run:
        """Run a scenario, or read a run; see :func:`ffsm_run`."""


@pytest.fixture(scope="session")
def ffsm_run(tmp_path_factory: pytest.TempPathFactory) -> RunFactory:
    """Function that simulates a scenario once per session and gives the run as its log tells it.

    ``ffsm_run(source, overrides=(), *, rerun=False)``: ``source`` is a scenario file, the name of a shipped scenario, or an
    existing run (its folder, ``.mcap`` or ``.mcap.partial``), which is only read; ``overrides`` are those of
    :func:`ffsm_mj.run`; ``rerun`` writes the recording for the Rerun viewer too. The same source and overrides give the
    same object again. ``run.path.parent`` is the run folder.
    """
    cache: dict[tuple[str, str, bool], Run] = {}

    def run(source: str | Path, overrides: Overrides = (), *, rerun: bool = False) -> Run:
        import ffsm_mj
        from ffsm_mj.errors import InputError

        changes = sorted(overrides.items()) if isinstance(overrides, Mapping) else list(overrides)
        path = Path(source)
        logged = path.is_dir() or ".mcap" in path.suffixes
        where, what = str(path.resolve()) if path.exists() else str(source), repr(changes)
        if (where, what, True) not in cache and (where, what, rerun) not in cache:
            if logged and changes:
                raise ValueError(f"{source} is a finished run: overrides can change nothing in it")
            folder = path if logged else tmp_path_factory.mktemp("ffsm-runs") / path.stem
            try:
                if not logged:
                    ffsm_mj.run(source, overrides, out=folder, rerun=rerun, check=False)
                cache[where, what, rerun] = ffsm_mj.load_run(folder)
            except InputError as error:
                pytest.fail(str(error), pytrace=False)
        return cache.get((where, what, True)) or cache[where, what, rerun]

    return run


def assert_conserved(run: Run, tolerance: Tolerance = 1e-9, *, checks: Sequence[str] = ()) -> None:
    """Assert that a run obeys the conservation laws, by the energies, momenta and balance in its log.

    All checks are made, those that need the models too; nothing is simulated again.

    Args:
        run: A run of :func:`ffsm_mj.run`, :func:`ffsm_mj.load_run` or the fixture ``ffsm_run``.
        tolerance: A residual may reach this times (1 + scale) in SI units; one number, or by check.
        checks: Names of the checks to check (``energy``, ``linear momentum``, ...); all when empty.

    Raises:
        AssertionError: a check fails (the message says which, whose, by how much, where and when), the run is not
            conservative, or it has no samples.
        ValueError: No such check.
    """
    __tracebackhide__ = True
    from ffsm_mj.analysis.run_models import all_checks
    from ffsm_mj.errors import unknown_name
    from ffsm_mj.verification.checks import CHECK_NAMES
    from ffsm_mj.verification.truncation import has_question

    for name in checks:
        if name not in CHECK_NAMES:
            raise ValueError(unknown_name("check", name, CHECK_NAMES))
    checked = [check for check in all_checks(run, tolerance) if not checks or check.name in checks]
    if not run.conservative:
        raise AssertionError(f"{run.name} is not conservative: {run.why_not_conservative}")
    if not checked:
        raise AssertionError(f"{run.name}: the log holds nothing to check")
    broken = [check for check in checked if not check.passes]
    if broken:
        lines = [
            f"{check.name} of {check.subsystem}: residual {check.residual:.3e} {check.unit} in {check.component} "
            f"at {check.time_s:.3f} s, allowed {check.tolerance:.3e}"
            for check in broken
        ]
        head = f"{run.name}: {len(broken)} of {len(checked)} checks failed in {run.digest.end_s:g} s"
        if has_question(broken, tolerance):
            head += "; ffsm_mj.explain(run) finds whether by the truncation of the step alone"
        raise AssertionError("\n  ".join([head, *lines]))
