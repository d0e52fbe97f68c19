"""Common style of figures: colours, line styles, sizes, and reproducible files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from ffsm_mj.errors import one_line
from ffsm_mj.log import palette
from ffsm_mj.log.palette import hexadecimal
from ffsm_mj.report.output_place import new_file

BLACK, ORANGE, SKY, GREEN, BLUE, VERMILION, PURPLE = map(
    hexadecimal,
    (palette.BLACK, palette.ORANGE, palette.SKY, palette.GREEN, palette.BLUE, palette.VERMILION, palette.PURPLE),
)
MARK, TARGET = map(hexadecimal, (palette.MARK, palette.TARGET))
TIP_BEFORE, TIP_AFTER = map(hexadecimal, (palette.TIP_BEFORE, palette.TIP_AFTER))
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, BLACK)
# Line styles distinguish the curves in greyscale.
LINE_STYLES: tuple[str | tuple[int, tuple[float, ...]], ...] = (
    "-",
    (0, (5.0, 1.5)),
    (0, (6.0, 1.5, 1.2, 1.5)),
    (0, (1.5, 1.2)),
    (0, (8.0, 2.0)),
    (0, (3.0, 1.0, 1.0, 1.0, 1.0, 1.0)),
    (0, (2.5, 2.5)),
)
WIDTH_IN = 7.0
"""Width of a figure: two columns of a journal page, in."""
FORMATS = ("png", "svg")

_RC = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.labelsize": 8.5,
    "axes.titlesize": 9.0,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
    "grid.color": "#D5D5D5",
    "grid.linewidth": 0.5,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "lines.linewidth": 1.3,
    "lines.solid_capstyle": "butt",
    "xtick.direction": "out",
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "figure.constrained_layout.use": True,
    "figure.facecolor": "white",
    "svg.hashsalt": "ffsm-mj",
    "path.simplify": True,
}


def plain(text: str) -> str:
    """Escape a name for Matplotlib: names in a log are arbitrary, and a pair of dollar signs would start math text."""
    return one_line(text).replace("$", r"\$")


@contextmanager
def publication() -> Iterator[None]:
    """Context with the style of figures, independent of the user's own settings."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_RC)
        yield


def write(figure: Figure, folder: Path, name: str, formats: tuple[str, ...] = FORMATS, *, dpi: int = 220) -> list[Path]:
    """Write a figure in each format, reproducible byte for byte."""
    paths = []
    with publication():
        for form in formats:
            path = folder / f"{name}.{form}"
            metadata = {"Date": None, "Creator": "ffsm-mj"} if form == "svg" else {"Software": "ffsm-mj"}
            with new_file(path) as place:
                figure.savefig(place, format=form, dpi=dpi, metadata=metadata)
            paths.append(path)
    return paths
