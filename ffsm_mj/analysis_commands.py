"""What ``ffsm analyze`` and ``ffsm export`` do, given their options; the command line only parses."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from ffsm_mj.analysis import Run, compare, load_run
from ffsm_mj.conservation import DEFAULT_TOLERANCE, LAW_NAMES, Tolerance
from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.text_report import as_json, comparison_report, verification, verification_data, violated

Say = Callable[[str], None]
_EXPORT_SUFFIX = {"csv": ".csv", "parquet": ".parquet", "gif": ".gif", "mp4": ".mp4"}


def analyze(options: argparse.Namespace, say: Say) -> bool:
    """Verify each run, print, draw and compare as asked.

    Returns:
        Whether every law that should hold does, in every run.

    Raises:
        InputError: A run cannot be read or holds no sample, a tolerance names no law, or options exclude each other.
    """
    if options.json and options.compare:
        raise InputError("--compare prints text: leave --json out, or call ffsm_mj.compare(a, b) in Python")
    if options.compare and len(options.runs) < 2:
        raise InputError("--compare: name two runs or more")
    tolerance = _tolerance(options.tolerance)
    names = run_names(options.runs)
    several = len(names) > 1
    data, bad, kept = [], [], []
    for path, name, run in _load_all(options.runs, names):
        if violated(run, tolerance):
            bad.append(name)
        if options.json:
            data.append(verification_data(run, tolerance))
        else:
            say(f"{path.resolve()}\n\n{verification(run, tolerance)}" + "\n" * (several or options.plots is not None))
        if options.plots:
            _plot(run, Path(options.plots) / name if several else Path(options.plots), None if options.json else say)
        if several and (options.compare or options.plots):
            kept.append((name, run))
    if options.json:
        say(as_json(data if several else data[0]))
    elif several:
        say(f"{len(names) - len(bad)} of {len(names)} runs verified" + (f"; VIOLATED in {', '.join(bad)}" if bad else ""))
    if options.compare:
        _compare(kept, say)
    if options.plots and several:
        _plot_comparison(kept, Path(options.plots), None if options.json else say)
    return not bad


def _tolerance(given: Sequence[tuple[str, float]]) -> Tolerance:
    tolerances = dict.fromkeys(LAW_NAMES, DEFAULT_TOLERANCE)
    for name, value in sorted(given, key=lambda pair: pair[0] != ""):  # those for one law have the last word
        if name and name not in LAW_NAMES:
            raise InputError(f"--tolerance: {unknown_name('law', name, LAW_NAMES)}")
        tolerances |= dict.fromkeys([name] if name else LAW_NAMES, value)
    return tolerances


def run_names(paths: Sequence[str]) -> list[str]:
    """A short name for each run: its folder's, numbered where two have the same."""
    names: list[str] = []
    for text in paths:
        path = Path(text).resolve()
        name = path.parent.name if path.name.startswith("run.mcap") else path.name.split(".mcap")[0]
        candidates = (name, *(f"{name}-{i}" for i in range(2, len(paths) + 2)))
        names.append(next(candidate for candidate in candidates if candidate not in names))
    return names


def _load_all(paths: Sequence[str], names: Sequence[str]) -> Iterator[tuple[Path, str, Run]]:
    for path, name in zip(paths, names, strict=True):
        run = load_run(path)
        if not len(run.time):
            raise InputError(f"{path}: the log holds no sample, there is nothing to verify")
        yield Path(path), name, run


def _compare(runs: Sequence[tuple[str, Run]], say: Say) -> None:
    for name, run in runs[1:]:
        say("\n" + comparison_report((runs[0][0], name), compare(runs[0][1], run)))


def _plot(run: Run, folder: Path, say: Say | None) -> None:
    from ffsm_mj.plots import save  # matplotlib: for those who want figures

    files = save(run, folder)
    if say is not None:
        say(f"figures in {folder}: {', '.join(dict.fromkeys(file.stem for file in files))} (svg, png)")


def _plot_comparison(runs: Sequence[tuple[str, Run]], folder: Path, say: Say | None) -> None:
    from ffsm_mj.plots import MOST_RUNS, save_comparison

    save_comparison(runs, folder)
    if say is not None:
        left_out = f", the first {MOST_RUNS} runs" if len(runs) > MOST_RUNS else ""
        say(f"figures in {folder}: comparison (svg, png){left_out}")


def export(options: argparse.Namespace, say: Say) -> None:
    """Write a table or an animation of a run.

    Raises:
        InputError: The run cannot be read, or there is no such table.
        MissingPackageError: A package that only this needs is not installed.
    """
    run = load_run(options.run)
    film = options.form in ("gif", "mp4")
    assert run.path is not None
    name = "motion" if film else options.table
    out = Path(options.out) if options.out else run.path.with_name(name + _EXPORT_SUFFIX[options.form])
    if film:
        from ffsm_mj.animation import write_animation

        say(f"{out}: {write_animation(run, out, frames_per_second=options.fps, speed=options.speed)}")
    else:
        from ffsm_mj.export import write_table

        say(f"{out}: {write_table(run, options.table, out, options.form)}")
