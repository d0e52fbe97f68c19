"""The run that users hold: its arrays, and how it shows itself in a terminal or a notebook."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ffsm_mj.analysis import run as analysis
from ffsm_mj.log.mcap.reader import read_log
from ffsm_mj.log.run_folder import find_log
from ffsm_mj.report.run_card import card_html, card_text

if TYPE_CHECKING:
    from ffsm_mj.report.film import Film
    from ffsm_mj.report.plots.shown import Figures


class Run(analysis.Run):
    """A run that shows itself: as the last value of a notebook's cell a table, its figures, a film of its motion."""

    def __repr__(self) -> str:
        """Scenario, outcome, impacts, contacts that lasted, the check nearest to its limit, and the tip."""
        return card_text(self)

    def _repr_html_(self) -> str:
        return card_html(self)

    # What is not finite in a run says so in its figures; numpy's warnings would say it twice.
    @np.errstate(all="ignore")
    def plot(self, *names: str) -> Figures:
        """Figures of the run, those of ``ffsm analyze --plots``, by name; a notebook's cell shows them.

        Args:
            names: Only these: ``motion``, ``base``, ``joints``, ``tip``, ``torques``, ``inputs``, ``contacts``, ``momenta``,
                ``energies``, ``conservation``; all that the run has when empty.

        Raises:
            InputError: The run has no samples, or its models do not compile any more.
            KeyError: The run has no figure of that name; the message lists those it has.
        """
        from ffsm_mj.report.plots.shown import shown

        return shown(self, names)

    @np.errstate(all="ignore")
    def animate(self, *, frames_per_second: float = 20.0, speed: float | None = None) -> Film:
        """A film of the motion, that of ``ffsm export --gif``: shown by a notebook's cell; its ``save(path)`` keeps it.

        Args:
            frames_per_second: Pictures per second of the film, up to 50.
            speed: Times real time; None: so that the film lasts 12 s at most.

        Raises:
            InputError: The run has no samples, its models do not compile any more, or the film would be too long.
            ValueError: A rate or a speed that is none.
        """
        from ffsm_mj.report.film import film

        return film(self, frames_per_second, speed)


def load_run(path: str | Path) -> Run:
    """Read a run from its folder or its ``.mcap`` or ``.mcap.partial`` file.

    Raises:
        InputError: There is no log at that place.
        LogError: The file is no log of a run.
    """
    found = find_log(Path(path))
    return Run(read_log(found), found.absolute())
