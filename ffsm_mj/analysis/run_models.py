"""What follows from a run with its models: effort, base rotation, angular momentum, all checks, and ``summary.json``."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ffsm_mj.analysis.effort import Effort
from ffsm_mj.analysis.summary import failing_checks
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log, scenario_data
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE, Tolerance
from ffsm_mj.verification.model_checks import ModelChecks, Models

if TYPE_CHECKING:
    from ffsm_mj.analysis.digest import Digest
    from ffsm_mj.analysis.run import Run
    from ffsm_mj.verification.check_result import Check


class RunModels:
    """The models of a run and what is computed with them, once, when it is first asked for.

    Of a run that was simulated in this process they are those that it ran with; otherwise those in its log are compiled.
    """

    def __init__(
        self,
        log: RunLog,
        digest: Callable[[], Digest],
        compiled: Models | None = None,
        effort: Effort | None = None,
    ) -> None:
        """Bind to a run.

        Args:
            log: Its log.
            digest: Returns the digest of its rows.
            compiled: Returns its compiled models and its scenario as plain data; None: they are taken from the log.
            effort: Effort in all of its rows; None: computed from those in the log.
        """
        self._log, self._digest, self._accumulated = log, digest, effort
        self._compile = compiled or (lambda: (compile_log(log), scenario_data(log)))

    @cached_property
    def checks(self) -> ModelChecks:
        """Checks with the models."""
        return ModelChecks(self._log, self._digest().kept, self._compile, self._stack_momentum)

    @cached_property
    def effort(self) -> dict[str, Any]:
        """``effort``, ``base_rotation`` and ``angular_momentum`` of ``summary.json``.

        Each is None if the log lacks its columns or its models.
        """
        if self._accumulated is not None:
            return self._accumulated.summary()
        try:
            found = Effort(compile_log(self._log))
            found.open(self._log.header)
        except (InputError, KeyError):  # models that no longer compile, or a part of the columns
            return {"effort": None, "base_rotation": None, "angular_momentum": None}
        for block in self._log.blocks():
            found.rows(block)
        for event in self._log.events():
            found.event(event)
        return found.summary()

    def _stack_momentum(self) -> float:
        """Angular momentum of robot and grasped object at the end without the wheels, N m s; NaN if it is unknown."""
        found = self.effort["angular_momentum"]
        return math.nan if found is None else float(found["stack_without_wheels_N_m_s"])


def effort(run: Run) -> dict[str, dict[str, float | None]] | None:
    """Effort by actuator, under its name in the columns; None if the log lacks its columns or its models.

    ``integral_u2`` (N^2 s or (N m)^2 s), ``work_J``, ``peak`` (N or N m) and ``at_bound``, the share of the ticks at which
    the applied effort is at a bound: see :data:`ffsm_mj.analysis.effort.MEASURES`.
    """
    found: dict[str, dict[str, float | None]] | None = deepcopy(run.models.effort["effort"])
    return found


def base_rotation(run: Run) -> dict[str, float] | None:
    """Angle from the first orientation of the base, ``final_rad`` and ``largest_rad``; None: see :func:`effort`."""
    found: dict[str, float] | None = deepcopy(run.models.effort["base_rotation"])
    return found


def angular_momentum(run: Run) -> dict[str, Any] | None:
    """Angular momentum before and after by subsystem and body, and what each actuator took; None: see :func:`effort`.

    About the centre of mass of everything that moves, world axes, N m s; :func:`ffsm_mj.analysis.tables.momentum_table`
    makes a table of it. See :class:`ffsm_mj.analysis.momentum_exchange.MomentumExchange`.
    """
    found: dict[str, Any] | None = deepcopy(run.models.effort["angular_momentum"])
    return found


def all_checks(run: Run, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Check, ...]:
    """Results of all checks of a run: ``run.checks()``, and those that need its models.

    Nothing is simulated again: whether checks fail by the truncation of the step alone, :func:`ffsm_mj.replay.explain` finds
    out.

    Args:
        run: The run.
        tolerance: See :func:`ffsm_mj.verification.checks.evaluate_checks`.

    Raises:
        KeyError: A tolerance for an unknown check.
    """
    return run.models.checks.all_checks(run.digest.check_accumulator, tolerance)


def summary(run: Run, checks: Sequence[Check] | None = None) -> dict[str, Any]:
    """Content of ``summary.json``: ``run.summary()`` with ``checks``, ``effort``, ``base_rotation``, ``angular_momentum``.

    Args:
        run: The run.
        checks: Results of all of its checks, where they are known already, as from :func:`ffsm_mj.explain`.
    """
    judged = all_checks(run) if checks is None else checks
    return run.summary() | deepcopy(run.models.effort) | {"checks": failing_checks(judged)}
