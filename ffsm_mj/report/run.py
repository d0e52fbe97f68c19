"""The public run object: arrays, and representations for a terminal and a notebook."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from ffsm_mj.analysis import run as analysis
from ffsm_mj.log.mcap.reader import read_log
from ffsm_mj.log.run_folder import find_log
from ffsm_mj.report.run_card import card_html, card_text
from ffsm_mj.verification.check_result import Check
from ffsm_mj.verification.checks import DEFAULT_TOLERANCE
from ffsm_mj.verification.truncation import has_question

if TYPE_CHECKING:
    from ffsm_mj.report.film import Film
    from ffsm_mj.report.plots.notebook import Figures


class Run(analysis.Run):
    """A run with a summary table for notebooks, figures and an animation."""

    def __repr__(self) -> str:
        """Scenario, outcome, impacts, persistent contacts, the check closest to its tolerance, and the tip."""
        return card_text(self)

    def _repr_html_(self) -> str:
        return card_html(self)

    # Values that are not finite show in the figures; numpy's warnings would only repeat that.
    @np.errstate(all="ignore")
    def plot(self, *names: str) -> Figures:
        """Figures of the run by name, those of ``ffsm analyze --plots``; a notebook displays them.

        Args:
            names: Only these: ``motion``, ``base``, ``joints``, ``tip``, ``torques``, ``inputs``, ``contacts``, ``momenta``,
                ``energies``, ``conservation``; all that the run has when empty.

        Raises:
            InputError: The run has no samples, or its models no longer compile.
            KeyError: The run has no figure of that name; the message lists those it has.
        """
        from ffsm_mj.report.plots.notebook import notebook_figures

        return notebook_figures(self, names)

    @np.errstate(all="ignore")
    def animate(self, *, frames_per_second: float = 20.0, speed: float | None = None) -> Film:
        """Animation of the motion, that of ``ffsm export --gif``; a notebook displays it, ``save(path)`` writes it.

        Args:
            frames_per_second: Frame rate, up to 50.
            speed: Playback speed relative to real time; None: at most 12 s of video.

        Raises:
            InputError: The run has no samples, its models no longer compile, or the animation would be too long.
            ValueError: An invalid frame rate or speed.
        """
        from ffsm_mj.report.film import film

        return film(self, frames_per_second, speed)

    def analyze_truncation(
        self, budget_s: float | None = None, *, report: Callable[[float, float], None] | None = None
    ) -> tuple[Check, ...]:
        """Find out whether checks fail by the truncation of the step alone, by a replay with shorter steps.

        The replay starts at the states in the log and takes several times as long as the run. Neither ``checks`` nor the
        representation of a run starts it; afterwards both state its result, as does ``summary``. No effect if no check of
        energy, momenta or heat fails.

        Args:
            budget_s: Largest wall time, s; None: that of the run itself, 20 s at least.
            report: Called with the number of samples done and their total.

        Returns:
            Results of all checks. ``check.truncation`` is the share of truncation in one that fails,
            ``check.fails_by_truncation`` the verdict: None if the budget did not suffice or the log cannot be replayed, for
            the reason in ``run.truncation.obstacle``.
        """
        # The replay is above this package.
        replay = import_module("ffsm_mj.replay.truncation")
        if has_question(self.checks(), DEFAULT_TOLERANCE):
            seconds = replay.usual_seconds(self.log) if budget_s is None else budget_s
            limits = replay.AnalysisLimits(seconds, report=report)
            self.truncation = replay.analyze_truncation(self.log, self.checks(), limits)
        return self.checks()

    def sensitivity(
        self,
        of: Sequence[str] | str = (),
        wrt: Mapping[str, float] = MappingProxyType({}),
        kind: str = "secant",
        *,
        controllers: Mapping[str, Any] = MappingProxyType({}),
        estimators: Mapping[str, Any] = MappingProxyType({}),
    ) -> Any:
        """How outcomes of the run change with uncertain numbers of its scenario; see docs/sensitivity.md.

        Args:
            of: Outcomes, by their names in ``summary.json``: ``impacts.0.impulse_N_s``; those of the first impact and of the
                tip if none is named.
            wrt: Standard deviation of each uncertain number, by dotted key of the scenario; its ``uncertainties`` if none is
                given.
            kind: ``secant``: two runs per number, at plus and minus one standard deviation; it refuses nothing. ``exact``:
                the derivative, where it exists.
            controllers: Control laws of the caller's own, see :func:`ffsm_mj.run`.
            estimators: Estimators of the caller's own.

        Returns:
            A :class:`~ffsm_mj.sensitivity.result.Sensitivity`.

        Raises:
            InputError: An unknown name, or a derivative that does not exist.
        """
        # Runs are made above this package.
        module = import_module("ffsm_mj.sensitivity.of_run")
        return module.sensitivity(self, of, wrt, kind, controllers=controllers, estimators=estimators)


def load_run(path: str | Path) -> Run:
    """Read a run from its folder or its ``.mcap`` or ``.mcap.partial`` file.

    Raises:
        InputError: There is no log at that path.
        LogError: The file is not the log of a run.
    """
    found = find_log(Path(path))
    return Run(read_log(found), found.absolute())
