"""What follows from a run with its models: effort, base rotation, angular momentum, all checks, and ``summary.json``."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

from ffsm_mj.analysis.pacing import Pacing
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.summary import failing_checks
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, Tolerance


def effort(run: Run) -> dict[str, dict[str, float | None]] | None:
    """Effort by actuator, under its name in the columns; None if the log lacks its columns or its models.

    ``integral_u2`` (N^2 s or (N m)^2 s), ``work_J``, ``peak`` (N or N m) and ``at_bound``, the share of the ticks at which
    the applied effort is at a bound: see :data:`ffsm_mj.analysis.effort.MEASURES`.
    """
    efforts: dict[str, dict[str, float | None]] | None = deepcopy(run.models.effort["effort"])
    return efforts


def base_rotation(run: Run) -> dict[str, float] | None:
    """Angle from the first orientation of the base, ``final_rad`` and ``largest_rad``; None: see :func:`effort`."""
    rotation: dict[str, float] | None = deepcopy(run.models.effort["base_rotation"])
    return rotation


def angular_momentum(run: Run) -> dict[str, Any] | None:
    """Angular momentum before and after by subsystem and body, and what each actuator took; None: see :func:`effort`.

    About the centre of mass of everything that moves, world axes, N m s; :func:`ffsm_mj.analysis.tables.momentum_table`
    makes a table of it. See :class:`ffsm_mj.analysis.effort.MomentumExchange`.
    """
    momentum: dict[str, Any] | None = deepcopy(run.models.effort["angular_momentum"])
    return momentum


def all_checks(run: Run, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Check, ...]:
    """Results of all checks of a run: ``run.checks()``, and those that need its models.

    Nothing is simulated again: whether checks fail by the truncation of the step alone, :func:`ffsm_mj.replay.explain` finds
    out.

    Args:
        run: The run.
        tolerance: See :func:`ffsm_mj.verification.checks.tolerances`.

    Raises:
        KeyError: A tolerance for an unknown check.
    """
    return run.models.all_checks(run.digest, tolerance)


def summary(run: Run, checks: Sequence[Check] | None = None) -> dict[str, Any]:
    """Content of ``summary.json``: ``run.summary()`` with ``checks``, efforts, and ``realtime`` of a run in real time.

    Args:
        run: The run.
        checks: Results of all of its checks, where they are known already, as from :func:`ffsm_mj.explain`.
    """
    judged = all_checks(run) if checks is None else checks
    pacing = Pacing.of(run)
    paced = {"realtime": pacing.summary()} if pacing is not None else {}
    return run.summary() | deepcopy(run.models.effort) | paced | {"checks": failing_checks(judged)}
