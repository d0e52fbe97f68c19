"""Publication-quality figures of a run, drawn from its log alone.

``figures(run)`` returns them by name; ``save(run, folder)`` writes them as SVG and PNG, reproducible byte for byte.
``comparison(runs)`` overlays several runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ffsm_mj.analysis.run import Run
from ffsm_mj.log.markers import has_orbit
from ffsm_mj.report.output_place import usable_folder, writing
from ffsm_mj.report.plots.intervals import contacts, grasps
from ffsm_mj.report.plots.motion import motion
from ffsm_mj.report.plots.orbit import lvlh, orbit
from ffsm_mj.report.plots.panels import envelope
from ffsm_mj.report.plots.sensing import estimates, sensors
from ffsm_mj.report.plots.style import COLOURS, FORMATS, LINE_STYLES, WIDTH_IN, plain, publication, write
from ffsm_mj.report.plots.subject import Subject
from ffsm_mj.report.plots.thinning import thinned
from ffsm_mj.report.plots.time_series import (
    CONSERVED,
    base,
    conservation,
    energies,
    has_springs,
    inputs,
    joints,
    momenta,
    springs,
    tip,
    torques,
)

__all__ = ["FORMATS", "MOST_RUNS", "comparison", "figure_names", "figures", "save", "save_comparison"]

MOST_RUNS = len(COLOURS)
"""More curves than this cannot be distinguished in one pair of axes."""


def figures(run: Run, names: Sequence[str] = (), *, titled: bool = True) -> dict[str, Figure]:
    """Every figure that a run can have, by name.

    ``motion``, ``orbit`` and ``lvlh`` (in orbit), ``base``, ``joints``, ``tip`` (with a task), ``torques`` (with motors),
    ``inputs`` (if a thruster or wheel is active), ``contacts`` (with persistent contacts), ``grasps`` (with grasps),
    ``sensors``, ``estimates`` (with an estimator), ``springs`` (of joints), ``momenta``, ``energies``, ``conservation`` (if
    energy and momenta are checked).

    Args:
        run: A run with at least one sample.
        names: Only these, where the run has them; all when empty.
        titled: Whether the name of the scenario is above each.

    Raises:
        InputError: The run has no samples, or its models no longer compile.
    """
    makers = _makers(run, names)
    with publication():
        return {name: _titled(make(), run) if titled else make() for name, make in makers.items()}


def _titled(figure: Figure, run: Run) -> Figure:
    """A figure with the name of its run's scenario above it."""
    figure.suptitle(plain(run.name), x=0.01, ha="left", fontsize=8.0, color="#444444")
    return figure


def figure_names(run: Run) -> list[str]:
    """Names of the figures that a run can have; see :func:`figures`."""
    return list(_makers(run, ()))


def _makers(run: Run, names: Sequence[str]) -> dict[str, Callable[[], Figure]]:
    """Functions that draw the figures that a run can have, by name; see :func:`figures`."""
    subject = Subject(run)
    makers = {"motion": motion, **({"orbit": orbit, "lvlh": lvlh} if has_orbit(run.log.header.layout) else {}), "base": base}
    makers |= {"joints": joints} if subject.arm_joints else {}
    makers |= {"tip": tip} if run.summary()["tip"] is not None else {}
    makers |= {"torques": torques} if subject.named("motor") else {}
    makers |= {"inputs": inputs} if subject.base_actuated else {}
    makers |= {"contacts": contacts} if run.contacts else {}
    makers |= {"grasps": grasps} if run.grasps else {}
    makers |= {"sensors": sensors} if any(key.startswith("sensor.") for key in run.keys) else {}
    makers |= {"estimates": estimates} if any(key.startswith("estimate.error_") for key in run.keys) else {}
    makers |= {"springs": springs} if has_springs(run) else {}
    makers |= {"momenta": momenta, "energies": energies}
    makers |= {"conservation": conservation} if any(check.name in CONSERVED for check in run.checks()) else {}
    return {name: partial(make, subject) for name, make in makers.items() if not names or name in names}


def save(
    run: Run,
    folder: str | Path,
    names: Sequence[str] = (),
    formats: tuple[str, ...] = FORMATS,
    report: Callable[[float, float], None] | None = None,
) -> list[Path]:
    """Write the figures of a run into a folder as ``<name>.<format>``, one after the other; see :func:`figures`.

    Args:
        run: A run with at least one sample.
        folder: Output folder; created if it does not exist.
        names: Only these, where the run has them; all when empty.
        formats: File formats.
        report: Callback (figures written, figures in all).

    Returns:
        The files written.

    Raises:
        InputError: See :func:`figures`; or the folder is not writable.
        OutputLostError: A file could not be written completely.
    """
    target, makers = Path(folder), _makers(run, names)
    usable_folder(target)
    files: list[Path] = []
    for done, (name, make) in enumerate(makers.items()):
        if report is not None:
            report(done, len(makers))
        with publication():
            figure = _titled(make(), run)
        with writing(target):
            files += write(figure, target, name, formats)
    return files


def save_comparison(runs: Sequence[tuple[str, Run]], folder: str | Path, formats: tuple[str, ...] = FORMATS) -> list[Path]:
    """Write ``comparison.<format>``: an overlay of several labelled runs.

    Returns:
        The files written.

    Raises:
        InputError: The folder is not writable.
        OutputLostError: A file could not be written completely.
    """
    target = Path(folder)
    usable_folder(target)
    with publication():
        figure = comparison(runs)
    with writing(target):
        return write(figure, target, "comparison", formats)


def comparison(runs: Sequence[tuple[str, Run]]) -> Figure:
    """Figure of the first ``MOST_RUNS`` of several labelled runs."""
    shown = [(label, thinned(run)) for label, run in runs[:MOST_RUNS]]
    panels = ["kinetic energy, J", "robot $|P|$, N s", "object $|P|$, N s"]
    tipped = [(label, run) for label, run in shown if run.summary()["tip"] is not None]
    labels = (["tip error, m"] if tipped else []) + panels
    figure = Figure(figsize=(WIDTH_IN, 0.8 + 1.5 * len(labels)), layout="constrained")
    grid = figure.subplots(len(labels), 1, sharex=True, squeeze=False)[:, 0]
    drawn: dict[str, None] = {}
    for i, (label, run) in enumerate(shown):
        curves = [run["energy.total_J"], *(np.linalg.norm(run.momentum(p)[:, :3], axis=1) for p in ("robot", "objects"))]
        if tipped:
            missing = np.full(len(run.time), np.nan)
            curves.insert(0, run.tip_error() if run.summary()["tip"] is not None else missing)
        for axes, curve in zip(grid, curves, strict=True):
            x, y = envelope(run.time, curve)
            axes.plot(x, y, color=COLOURS[i], linestyle=LINE_STYLES[i], label=plain(label), zorder=3 + len(shown) - i)
        marks = run.log.marks()
        drawn |= dict.fromkeys(plain(kind.plural).replace("_", " ") for kind, *_ in marks)
        for time in sorted({time for _, time, _ in marks}):
            for axes in grid:
                axes.axvline(time, color=COLOURS[i], linewidth=0.8, linestyle=(0, (1, 1.5)), zorder=1)
    for axes, text in zip(grid, labels, strict=True):
        axes.set_ylabel(text)
        axes.margins(x=0.0)
    grid[-1].set_xlabel(f"time, s (dotted: {', '.join(drawn)})" if drawn else "time, s")
    figure.align_ylabels()
    handles, names = grid[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=min(4, len(names)))
    return figure
