"""Implementation of ``ffsm analyze``: replay logs, evaluate checks, write figures, compare runs."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from ffsm_mj.analysis.run import Run, compare, load_run
from ffsm_mj.assembly.process import noted
from ffsm_mj.cli.exit_codes import CHECK_FAILED, DAMAGED, OK, TRUNCATED
from ffsm_mj.cli.progress import Report, Stage
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.cli.truncation import PATIENCE, explained_checks
from ffsm_mj.errors import InputError, plural, unknown_name, working_on
from ffsm_mj.invocation import command
from ffsm_mj.replay import replay_log
from ffsm_mj.report.comparison_report import comparison_report
from ffsm_mj.report.output_place import folder_below, refuse_link, usable_folder
from ffsm_mj.report.verification_report import damage_of, json_text, verification, verification_data
from ffsm_mj.verification.check_result import Check, all_by_truncation
from ffsm_mj.verification.checks import CHECK_NAMES, DEEPEST_M, DEFAULT_TOLERANCE, RELATIVE_CHECKS, Tolerance
from ffsm_mj.verification.model_checks import ReplayResult
from ffsm_mj.verification.truncation import ExplainedChecks


# A log may hold any double. A value that is not finite fails its check; NumPy's warnings would only repeat that.
@np.errstate(all="ignore")
def analyze(options: argparse.Namespace, output: Output) -> int:
    """Replay each run and evaluate its checks; print, plot and compare as requested.

    Returns:
        The exit code: CHECK_FAILED if a check fails or a log disagrees with its states, else DAMAGED if a log is damaged,
        incomplete or has no models to replay it with, else TRUNCATED if checks fail by truncation of the step alone.

    Raises:
        InputError: A run cannot be read or has no samples, a tolerance names an unknown check, options are exclusive, or
            figures cannot be written to the given folder.
        OutputLostError: A figure could not be written completely.
    """
    _refuse_impossible(options)
    with output.progress() as stage:
        return _analyze(options, output, stage)


def _analyze(options: argparse.Namespace, output: Output, stage: Stage) -> int:
    tolerance = _tolerance(options.tolerance)
    names = run_names(options.runs)
    several = len(names) > 1
    data, kept = [], []
    by_code: dict[int, list[str]] = {OK: [], CHECK_FAILED: [], DAMAGED: [], TRUNCATED: []}
    shown = {name: f"{name} ({number} of {len(names)})" if several else name for number, name in enumerate(names, 1)}
    for path, name, run in _load_all(options.runs, shown, stage):
        with working_on(path):
            again = replay_log(run.log, stage(f"replay {shown[name]}", "samples"))
            with noted(PATIENCE) as stopped:
                explained = ExplainedChecks(again.checks(tolerance))
                if not again.obstacle:
                    limits = options.truncation, stage, shown[name], stopped
                    explained = explained_checks(run, explained.checks, *limits, tolerance)
                by_code[_judge(run, again, explained.checks)].append(name)
                if options.json:
                    data.append(verification_data(run, again, explained.checks))
                else:
                    text = verification(run, again, explained, tolerance)
                    text += "\n" * (several or options.plots is not None)
                    output.write(str(path.resolve()))
                    output.say(f"\n{text}")
                    for line in _internal_errors(run, options.runs, shown=options.traceback):
                        output.write(line)
            if options.plots:
                folder = folder_below(Path(options.plots), name) if several else Path(options.plots)
                _plot(run, folder, None if options.json else output, stage(f"figures of {shown[name]}", "figures"))
        if several and (options.compare or options.plots):
            kept.append((name, run))
    if options.json:
        output.write(json_text(data if several else data[0]))
    elif several:
        words = (
            (CHECK_FAILED, "; FAILED in "),
            (DAMAGED, "; damaged or incomplete: "),
            (TRUNCATED, "; truncation of the step: "),
        )
        rest = "".join(head + ", ".join(by_code[code]) for code, head in words if by_code[code])
        output.say(f"{len(by_code[OK])} of {plural(len(names), 'run')} verified{rest}")
    if options.compare:
        _compare(kept, output, stage)
    if options.plots and several:
        _plot_comparison(kept, Path(options.plots), None if options.json else output, stage)
    return next((code for code in (CHECK_FAILED, DAMAGED, TRUNCATED) if by_code[code]), OK)


def _internal_errors(run: Run, named: Sequence[str], *, shown: bool) -> Iterator[str]:
    """Traceback of each exception that ended a run, or the command that prints it."""
    for record in run.records["internal_errors"]:
        yield f"\n{record.traceback.rstrip()}" if shown else f"\ntraceback: {command('analyze', *named, '--traceback')}"


def _judge(run: Run, again: ReplayResult, checks: Sequence[Check]) -> int:
    """Exit code of one run: a failed check outranks a damaged log, which outranks truncation of the step."""
    truncated = all_by_truncation(checks)
    if not (truncated or all(check.passes for check in checks)) or not (again.agrees or again.obstacle):
        return CHECK_FAILED
    if not run.complete or damage_of(run, again) or again.obstacle:
        return DAMAGED
    return TRUNCATED if truncated else OK


def _tolerance(pairs: Sequence[tuple[str, float]]) -> Tolerance:
    tolerances = dict.fromkeys(RELATIVE_CHECKS, DEFAULT_TOLERANCE) | {"no penetration": DEEPEST_M}
    names = [name for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--tolerance: given twice for {name or 'all checks'}")
    for name, value in sorted(pairs, key=lambda pair: pair[0] != ""):  # a tolerance for one check overrides that for all
        if name and name not in CHECK_NAMES:
            raise InputError(f"--tolerance: {unknown_name('check', name, CHECK_NAMES)}")
        tolerances |= dict.fromkeys([name] if name else RELATIVE_CHECKS, value)
    return tolerances


def run_names(paths: Sequence[str]) -> list[str]:
    """A short name for each run: that of its folder, numbered if it is not unique."""
    names: list[str] = []
    for text in paths:
        path = Path(text).resolve()
        name = path.parent.name if path.name.startswith("run.mcap") else path.name.split(".mcap")[0]
        candidates = (name, *(f"{name}-{i}" for i in range(2, len(paths) + 2)))
        names.append(next(candidate for candidate in candidates if candidate not in names))
    return names


def _load_all(paths: Sequence[str], names: Mapping[str, str], stage: Stage) -> Iterator[tuple[Path, str, Run]]:
    """Each run with its path and name; ``names`` maps a name to its displayed form."""
    for path, (name, shown) in zip(paths, names.items(), strict=True):
        stage(f"read {shown}")
        with working_on(path):
            run = load_run(path)
        if not len(run.log.rows):
            ended = f" ({run.outcome}: {run.message})" if run.complete else ""
            raise InputError(f"{path}: the log has no samples, there is nothing to verify{ended}")
        yield Path(path), name, run


def _refuse_impossible(options: argparse.Namespace) -> None:
    if options.json and options.compare:
        raise InputError("--compare prints text: omit --json, or call ffsm_mj.compare(a, b) in Python")
    if options.json and options.traceback:
        raise InputError("--traceback prints text: omit --json, or read records['internal_errors'] in Python")
    if options.compare and len(options.runs) < 2:
        raise InputError("--compare: name two runs or more")
    if options.plots:
        refuse_link(Path(options.plots))
        usable_folder(Path(options.plots))


def _compare(runs: Sequence[tuple[str, Run]], output: Output, stage: Stage) -> None:
    for name, run in runs[1:]:
        stage(f"compare {name}")
        with working_on(run.path or name):
            output.say("\n" + comparison_report((runs[0][0], name), compare(runs[0][1], run)))


def _plot(run: Run, folder: Path, output: Output | None, report: Report | None) -> None:
    from ffsm_mj.report.plots import save  # matplotlib is slow to import

    files = save(run, folder, report=report)
    if output is not None:
        output.say(f"figures in {folder}: {', '.join(dict.fromkeys(file.stem for file in files))} (svg, png)")


def _plot_comparison(runs: Sequence[tuple[str, Run]], folder: Path, output: Output | None, stage: Stage) -> None:
    from ffsm_mj.report.plots import MOST_RUNS, save_comparison

    stage("comparison")
    with working_on(", ".join(str(run.path) for _, run in runs)):
        save_comparison(runs, folder)
    if output is not None:
        left_out = f", the first {MOST_RUNS} runs" if len(runs) > MOST_RUNS else ""
        output.say(f"figures in {folder}: comparison (svg, png){left_out}")
