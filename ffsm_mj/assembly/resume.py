"""What if: a logged run goes on from one of its instants, with some of its settings changed there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.assembly.prepare import PreparedRun, as_overrides, prepare
from ffsm_mj.errors import InputError
from ffsm_mj.invocation import on_command_line, override
from ffsm_mj.log.run_folder import SCENARIO, RunFolder


def prepare_from(
    run: str | Path,
    from_s: float,
    overrides: Sequence[str] | Mapping[str, Any] = (),
    *,
    controllers: Mapping[str, Any] = MappingProxyType({}),
    estimators: Mapping[str, Any] = MappingProxyType({}),
    check: bool = False,
) -> PreparedRun:
    """Prepare a run that goes on from an instant of a logged one; see :func:`resume`.

    It is the scenario of the logged run, with changes, and with its own folder and the instant as ``initial.from`` and
    ``initial.at_s``. ``check`` is that of :func:`ffsm_mj.assembly.prepare.prepare`.

    Raises:
        InputError: The folder has no scenario, the instant is not one of the run, or a setting cannot change there.
    """
    file = Path(run) / SCENARIO
    if not file.is_file():
        raise InputError(f"{run}: is no run folder that can go on: it has no {SCENARIO}")
    given = as_overrides(overrides)
    begin = ["initial.from=.", f"initial.at_s={from_s!r}"]
    try:
        return prepare(file, [*given, *begin], controllers=controllers, estimators=estimators, check=check)
    except InputError as error:
        name = "--from" if on_command_line() else "from_s"
        lines = [line.replace(f"{override(begin[1])}: initial.at_s", f"{name} {from_s:g}") for line in error.lines]
        raise InputError(lines) from error


def resume(
    run: str | Path,
    from_s: float,
    overrides: Sequence[str] | Mapping[str, Any] = (),
    *,
    controllers: Mapping[str, Any] = MappingProxyType({}),
    estimators: Mapping[str, Any] = MappingProxyType({}),
    out: str | Path | None = None,
    force: bool = False,
    rerun: bool | None = None,
    live: str | None = None,
    report: Callable[[float, float], None] | None = None,
    check: bool = True,
) -> Run:
    """Simulate on from an instant of a logged run, bit for bit, or with some of its settings changed there.

    Args:
        run: Folder of the logged run.
        from_s: The instant, s: the run goes on from the first control tick or event at or after it.
        overrides: Settings that change there: of phases, task, contacts, grasps, actuators and limits, or the duration. If
            phases or task change, the control law of the phase under way begins anew. Phases may have control laws of other
            kinds there, which begin without memory.
        controllers: See :func:`ffsm_mj.run`, likewise the others.
        estimators: Estimators of the caller's own.
        out: Run folder to write; None keeps the run in memory only.
        force: Replace a run that ``out`` already holds.
        rerun: Write ``run.rrd`` into the folder.
        live: ``host:port`` of a Rerun viewer.
        report: Told (simulation time, duration) in s as the run goes.
        check: Raise what ended the run by an exception, as :func:`ffsm_mj.run` does.

    Returns:
        The run from the instant on; its times are those of the logged run.

    Raises:
        InputError: See :func:`prepare_from`; or the run cannot be made again up to the instant.
    """
    folder = RunFolder(Path(out), force=force) if out is not None else None
    if folder is not None:
        folder.refuse_earlier_run()
    made = prepare_from(run, from_s, overrides, controllers=controllers, estimators=estimators, check=check)
    return made.run(folder=folder, rerun=rerun, live=live, report=report, check=check)
