"""Figures of a run for display in a notebook."""

from __future__ import annotations

import html
from base64 import b64encode
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import unknown_name
from ffsm_mj.report.plots import figure_names, figures
from ffsm_mj.report.plots.style import publication

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 110


class Figures(dict[str, "Figure"]):
    """Matplotlib figures by name, not registered with pyplot; ``figures["tip"].savefig(path)`` saves one."""

    def __missing__(self, name: str) -> Figure:
        """Raise KeyError with a message that lists the names."""
        raise KeyError(unknown_name("figure", name, self))

    def __repr__(self) -> str:
        """The names of the figures."""
        return f"<Figures {', '.join(self)}>"

    def _repr_html_(self) -> str:
        return "\n".join(
            f'<img alt="{html.escape(name)}" src="data:image/png;base64,{_png(figure)}">' for name, figure in self.items()
        )


def _png(figure: Figure) -> str:
    buffer = BytesIO()
    with publication():
        figure.savefig(buffer, format="png", dpi=_DPI)
    return b64encode(buffer.getvalue()).decode("ascii")


# Values that are not finite show in the figures; numpy's warnings would only repeat that.
@np.errstate(all="ignore")
def plot(run: Run, *names: str) -> Figures:
    """Figures of a run by name, those of ``ffsm analyze --plots``; a notebook displays them.

    Args:
        run: The run.
        names: Only these: ``motion``, ``base``, ``joints``, ``tip``, ``torques``, ``inputs``, ``contacts``, ``momenta``,
            ``energies``, ``conservation``; all that the run has when empty.

    Raises:
        InputError: The run has no samples, or its models no longer compile.
        KeyError: The run has no figure of that name; the message lists those it has.
    """
    plotted = Figures(figures(run, names))
    for name in names:
        if name not in plotted:
            raise KeyError(unknown_name("figure", name, figure_names(run)))
    return plotted
