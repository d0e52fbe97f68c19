"""A study in one call from a script."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ffsm_mj.campaign.execution.engines import importable
from ffsm_mj.campaign.script_classes import ScriptClasses
from ffsm_mj.errors import InputError
from ffsm_mj.scenario.source import source_of
from ffsm_mj.studies.plan import load_study, plan_study
from ffsm_mj.studies.study import Metrics, Study, functions_of
from ffsm_mj.yaml.parser import YamlFault, parse, write_yaml


def run_study(
    study: str | Path | Mapping[str, Any],
    out: str | Path,
    *,
    overrides: Sequence[str] = (),
    metrics: Metrics = MappingProxyType({}),
    controllers: Mapping[str, Any] = MappingProxyType({}),
    estimators: Mapping[str, Any] = MappingProxyType({}),
    workers: int | None = None,
    dask: str = "",
) -> Study:
    """Run variants of a scenario with the same samples, or continue to do so in a folder that holds the same study.

    Works in a script without a main guard, from standard input and in a notebook.

    Args:
        study: A study file, the name of a shipped study, or the content of a file, whose paths are relative to the current
            folder.
        out: Folder of the study.
        overrides: ``key=value`` overrides of the study file.
        metrics: Metrics of the caller: functions of a run by name, or a Python file whose functions they are.
        controllers: Control laws of the caller, classes by kind.
        estimators: Estimators of the caller, likewise.
        workers: Number of processes; None: that of the study file, else one per processor.
        dask: Address of a Dask scheduler, or ``local`` for a cluster on this machine.

    Returns:
        The study, with ``sentences()``, ``comparison()`` and ``table()``.

    Raises:
        InputError: The study is invalid, or the folder holds another one.
        EngineLostError: The workers are lost; the rows so far are kept.
    """
    own = ScriptClasses(dict(controllers), dict(estimators), functions_of(metrics))
    if isinstance(study, Mapping):
        name = Path("study")  # replaces the file name in messages
        try:
            root = parse(write_yaml(dict(study)), name)
        except YamlFault as fault:
            raise InputError(f"study: {fault.problem}") from fault
        plan = plan_study(source_of(root, name).overridden(overrides), own)
    else:
        plan = load_study(study, overrides, own)
    made = Study.begin(plan, Path(out))
    here = [name for name, each in own.every.items() if not importable(each)]
    if here and not dask:
        print(
            f"study: {', '.join(here)} cannot be imported by other processes: all runs are executed in this one",
            file=sys.stderr,
        )
    made.run(workers=workers, dask=dask)
    return made
