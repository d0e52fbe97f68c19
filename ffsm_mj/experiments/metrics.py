"""Metrics: scalars of a run that become columns of the table, by name; those of the caller, in a script or a file."""

from __future__ import annotations

import ast
import fnmatch
import hashlib
import linecache
import math
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache, lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

from ffsm_mj.analysis.effort import MEASURES, SUMMED
from ffsm_mj.analysis.intervals import ContactInterval, GraspInterval
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import Scenario
from ffsm_mj.errors import InputError, described, one_line, raised_at, unknown_name
from ffsm_mj.records.kinds import kinds
from ffsm_mj.verification.check_result import Check, all_by_truncation
from ffsm_mj.verification.checks import CHECK_NAMES


@dataclass(frozen=True)
class FileMetric:
    """A function of a file; picklable, because it carries the file's text, which every process executes itself.

    Attributes:
        name: Name of the function.
        file: Name of the file, for messages.
        text: Content of the file.
    """

    name: str
    file: str
    text: str

    def __call__(self, run: Run) -> Any:
        """Value of the metric for a run."""
        return self._function(run)

    @property
    def columns(self) -> Any:
        """Columns of the log that the function declares in its attribute ``columns``; None if it declares none."""
        return getattr(self._function, "columns", None)

    @property
    def _function(self) -> Any:
        return getattr(_module(self.file, self.text), self.name)


def read_metrics(path: Path) -> dict[str, FileMetric]:
    """Metrics of a file by name; the file is not executed.

    Args:
        path: The file.

    Raises:
        InputError: It cannot be read or parsed, defines no metric, or a public function of it does not take one argument.
    """
    try:
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text, str(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    except SyntaxError as error:
        raise InputError(f"{path}:{error.lineno or 1}:{error.offset or 1}: is not Python ({error.msg})") from error
    except ValueError as error:  # bytes that are no text, or null characters
        raise InputError(f"{path}: is not Python ({error})") from error
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name[0] != "_"}
    if not functions:
        raise InputError(f"{path}: defines no metric: a function of a run without a leading underscore in its name")
    for name, node in functions.items():
        arguments = node.args
        needed = len(arguments.posonlyargs) + len(arguments.args) - len(arguments.defaults)
        if needed != 1 or any(default is None for default in arguments.kw_defaults):
            raise InputError(
                f"{path}:{node.lineno}:{node.col_offset + 1}: {name} is no metric: a metric has one argument, the "
                "run; other functions need a name with a leading underscore"
            )
    return {name: FileMetric(name, path.name, text) for name in functions}


def execute_metrics(metrics: Mapping[str, Any]) -> None:
    """Execute the files of metrics once, so that an error in them is reported before the first run.

    Raises:
        InputError: A file raises an exception.
    """
    for metric in metrics.values():
        if isinstance(metric, FileMetric):
            try:
                _module(metric.file, metric.text)
            except (Exception, SystemExit) as error:
                raise InputError(f"{metric.file}: cannot be executed ({described(error)}{raised_at(error)})") from error


Metrics = Mapping[str, Callable[[Run], Any]] | str | Path
"""Metrics of the caller: functions by name, or a Python file."""


class MissingMetric:
    """Placeholder of a metric whose function is not given, for reading results."""

    def __call__(self, _: Run) -> Any:
        """No value."""
        raise NotImplementedError


def functions_of(metrics: Metrics) -> dict[str, Callable[[Run], Any]]:
    """Metrics of the caller by name; a file is not executed."""
    return dict(read_metrics(Path(metrics))) if isinstance(metrics, str | Path) else dict(metrics)


@lru_cache(maxsize=4)
def _module(file: str, text: str) -> ModuleType:
    """Module of a file, executed once per process and content."""
    # Named by its content: a worker may serve two campaigns whose files have the same name.
    module = ModuleType(f"ffsm_metrics_{hashlib.sha256(text.encode()).hexdigest()[:12]}")
    module.__file__ = file
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)  # tracebacks show its lines
    sys.modules[module.__name__] = module  # dataclasses look their module up
    exec(compile(text, file, "exec"), module.__dict__)
    return module


@dataclass(frozen=True)
class ScriptClasses:
    """Control laws and estimators of a script, classes by kind, and its metrics; picklable if they are.

    Attributes:
        controllers: Control laws.
        estimators: Estimators.
        metrics: Functions of a :class:`~ffsm_mj.analysis.run.Run` by the name of the metric.
    """

    controllers: Mapping[str, Any] = field(default_factory=dict)
    estimators: Mapping[str, Any] = field(default_factory=dict)
    metrics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def every(self) -> list[tuple[str, Any]]:
        """All of them with their names; a metric may have the name of a control law."""
        return [*self.controllers.items(), *self.estimators.items(), *self.metrics.items()]


NO_CLASSES = ScriptClasses()


def script_classes(scenario: object, controllers: Mapping[str, Any], estimators: Mapping[str, Any]) -> ScriptClasses:
    """Control laws and estimators of a caller, with those of a scenario that he built, or states by its keys."""
    of_scenario = vars(scenario) if isinstance(scenario, Scenario) else scenario if isinstance(scenario, Mapping) else {}
    return ScriptClasses(
        {**of_scenario.get("controllers", {}), **controllers}, {**of_scenario.get("estimators", {}), **estimators}
    )


GROUP = "ffsm_mj.metrics"
"""Entry-point group of metrics of other packages: the name is that of the metric, the object a function of a
:class:`~ffsm_mj.analysis.run.Run`. An optional attribute ``columns`` lists the columns it needs; only these are stored
during the run."""

FAULT = "fault."
"""Prefix of entries that say why a metric of the caller has no value."""
_EXACT = 1 << 53
"""Integers up to this magnitude are exact as doubles."""

Scalar = float | int | str | bool | None

_DRIFTING = CHECK_NAMES[:3]
IMPACTS = "impacts.count"
"""Metric of every run: the number of its impacts; contacts at one instant are one impact."""
COUNT = "count"
"""Runs whose checks fail by the truncation of the step alone pass; with ``fail`` they do not."""
_ALWAYS = (
    "checks_pass",
    "fails_by_truncation",
    "passes",
    "drift",
    "deepest_overlap_m",
    *(f"checks.{name.replace(' ', '_')}" for name in CHECK_NAMES),
)
"""Metrics of every run: whether all checks pass; whether the failing ones fail by the truncation of the step alone, null if
that is not known; whether the run passes by the rule of the campaign; the worst drift of energy and momenta over (1 +
scale); the deepest overlap in m; the worst residual of each check in its unit, null if the check was not evaluated."""
_EXCESS = {name: f"excess.{name.replace(' ', '_')}" for name in CHECK_NAMES}
"""Metric of each failing check: residual over tolerance, the worst of its subsystems."""
_TIP = ("min_error_m", "min_error_time_s", "final_error_m", "final_speed_m_s", *(f"target_m.{axis}" for axis in range(3)))
_SCALARS = ("outcome", "message", "duration_s", "steps", "conservative", "controller.ticks")
_CONSERVATION = ("energy_residual_J", "linear_momentum_residual_N_s", "angular_momentum_residual_N_m_s")
_ENDS = {"phases": ("end_s",)}


def check_metrics(checks: Sequence[Check], *, truncated: str = COUNT) -> dict[str, Scalar]:
    """Metrics of the checks, which every row has.

    Args:
        checks: Results of the checks, failing ones with their share of truncation.
        truncated: ``count``: a run whose checks fail by the truncation of the step alone passes; ``fail``: it does not.
    """
    values: dict[str, Scalar] = dict.fromkeys(_ALWAYS)
    failing = [check for check in checks if not check.passes]
    values["checks_pass"] = not failing
    values["fails_by_truncation"] = alone = all_by_truncation(checks)
    values["passes"] = not failing or (alone is True and truncated == COUNT)
    for check in checks:
        key = f"checks.{check.name.replace(' ', '_')}"
        worst = values[key]
        values[key] = check.residual if not isinstance(worst, float) else max(worst, check.residual)
        if check.name == "no penetration":
            values["deepest_overlap_m"] = check.residual
    for name, key in _EXCESS.items():
        if beyond := [_excess(check) for check in checks if check.name == name and not check.passes]:
            values[key] = max(beyond)
    drifts = [check.drift / check.tolerance * 1e-9 for check in checks if check.name in _DRIFTING]
    values["drift"] = max(drifts) if drifts else None
    return values


def _excess(check: Check) -> float:
    """Residual over tolerance; infinite if either is not a positive number."""
    return check.residual / check.tolerance if check.residual > 0.0 and check.tolerance > 0.0 else math.inf


def metric_values(
    run: Run,
    names: Sequence[str],
    checks: Mapping[str, Scalar] | None = None,
    script: Mapping[str, Callable[[Run], Any]] = MappingProxyType({}),
) -> dict[str, Scalar]:
    """Values of metrics of a run.

    Args:
        run: The run.
        names: Names of the metrics, in the order of the result.
        checks: Result of :func:`check_metrics`; None: computed from the checks of the run, with ``count``.
        script: Metrics of the caller; one that raises, or gives no valid number, has no value and an entry
            :data:`FAULT` that says why.

    Raises:
        ValueError: A metric is not a scalar of the run; the message names it.
    """
    summary = run.summary() | run.models.effort
    of_checks = {name: _scalar(name, value) for name, value in (checks or check_metrics(all_checks(run))).items()}
    plugins = plugin_metrics()
    values: dict[str, Scalar] = {}
    for name in names:
        if name in of_checks:
            values[name] = of_checks[name]
        elif name in script:
            values |= _script_value(name, script[name], run)
        elif name in plugins:
            values[name] = _scalar(name, plugins[name](run))
        elif name.startswith("effort.") and "*" in name:
            values[name] = _scalar(name, _effort_of_several(summary["effort"] or {}, name))
        else:
            values[name] = _scalar(name, value_at(summary, name))
    return of_checks | {IMPACTS: value_at(summary, IMPACTS)} | values


def _script_value(name: str, function: Callable[[Run], Any], run: Run) -> dict[str, Scalar]:
    """Value of a metric of the caller; None with a description of its fault if it has none."""
    try:
        value = function(run)
        scalar = _scalar(name, value)
    except (Exception, SystemExit) as error:  # noqa: BLE001 (code of the caller may raise anything)
        return {name: None, FAULT + name: described(error) + raised_at(error)}
    if scalar is None and value is not None:
        return {name: None, FAULT + name: one_line(f"not a finite number: {value}")}
    return {name: scalar}


def _effort_of_several(effort: Mapping[str, Mapping[str, float | None]], name: str) -> float | None:
    """Sum of the integrals or works of the actuators that match a pattern, or their largest peak or share at a bound."""
    actuators, _, measure = name.removeprefix("effort.").rpartition(".")
    values = [effort[actuator][measure] for actuator in fnmatch.filter(effort, actuators)]
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return None
    return sum(known) if measure in SUMMED else max(known)


def value_at(summary: Any, name: str) -> Any:
    """Value at a dotted path; None if the run has none."""
    if name == IMPACTS:  # contacts at one instant are one impact
        return len({contact["event"] for contact in summary.get("impacts", ())})
    for part in name.split("."):
        if isinstance(summary, Mapping):
            summary = summary.get(part)
        elif isinstance(summary, list | tuple):
            if part == "count":
                return len(summary)
            summary = summary[int(part)] if part.isdecimal() and int(part) < len(summary) else None
        else:
            return None
    return summary


def _scalar(name: str, value: Any) -> Scalar:
    """A number, text or flag as a plain Python object; None for a number that is not finite, a float for a large integer.

    Raises:
        ValueError: The value is of another type.
    """
    if hasattr(value, "item"):
        value = value.item()  # a scalar of NumPy
    if isinstance(value, float):
        return value if abs(value) < float("inf") else None
    if isinstance(value, str):
        return one_line(value)
    if isinstance(value, int) and abs(value) > _EXACT:
        return float(value) if abs(value) < 1 << 1023 else None
    if value is None or isinstance(value, bool | int):
        return value
    raise ValueError(f"metric {name!r} is no number, text or flag but a {type(value).__name__}")


def columns_of(
    names: Sequence[str], script: Mapping[str, Callable[[Run], Any]] = MappingProxyType({})
) -> tuple[str, ...] | None:
    """Columns that metrics need; None: all, because one of them does not declare its columns."""
    # What no metric needs is not kept: rows of 300 columns at 1 kHz are 2.4 MB per second of simulation, in every worker.
    needed: list[str] = []
    for name in names:
        function = script.get(name) or plugin_metrics().get(name)
        if function is not None:
            columns = getattr(function, "columns", None)
            if columns is None:
                return None
            needed += columns
    return tuple(dict.fromkeys(needed))


@cache
def plugin_metrics() -> dict[str, Callable[[Run], Any]]:
    """Metrics of installed packages; one that cannot be loaded raises when it is used."""
    return {point.name: _loaded(point) for point in entry_points(group=GROUP)}


def _loaded(point: Any) -> Callable[[Run], Any]:
    try:
        return point.load()  # type: ignore[no-any-return]
    except Exception as error:  # noqa: BLE001 (a plug-in may raise anything)
        why = described(error)

        def broken(_: Run) -> Any:
            raise ValueError(f"metric {point.name!r} of {point.value} cannot be loaded ({why})")

        return broken


def fault_of(name: str, actuators: Sequence[str], script: Iterable[str] = ()) -> str | None:
    """Why a name is not a metric; None if it may be one.

    Args:
        name: Name to check.
        actuators: Names of the scenario's actuators in the columns of a log.
        script: Names of the caller's own metrics.
    """
    if name in script:
        return None
    head, _, rest = name.partition(".")
    lists = record_lists()
    if head in lists:
        return fault_in_list(head, rest, lists[head])
    if head == "effort":
        actuator, _, measure = rest.rpartition(".")
        if fnmatch.filter(actuators, actuator) and measure in MEASURES:
            return None
        return unknown_name("metric", name, [f"effort.{key}.{measure}" for key in (*actuators, "*") for measure in MEASURES])
    if re.fullmatch(r"controller\.phases\.\d+\.reports\.(?:[\w-]+: )?\w+", name):
        return None
    known = [*_ALWAYS, *_EXCESS.values(), *_SCALARS, *plugin_metrics(), *script]
    known += [f"tip.{key}" for key in _TIP] + [f"conservation.{key}" for key in _CONSERVATION]
    known += ["base_rotation.final_rad", "base_rotation.largest_rad"]
    known += ["angular_momentum.stack_without_wheels_N_m_s", "angular_momentum.residual_N_m_s"]
    known += [f"{listed}.{what}" for listed in lists for what in ("count", "0.KEY")] + [
        "effort.ACTUATOR.MEASURE",
        "controller.phases.0.reports.NAME",
    ]
    return None if name in known else unknown_name("metric", name, known)


def record_lists() -> dict[str, Any]:
    """Types of the items of lists in ``summary.json``: records of all kinds, and intervals derived from them."""
    records = {kind.plural: kind.record for kind in kinds() if kind.plural and kind.summarised}
    return records | {"contacts": ContactInterval, "grasps": GraspInterval}


def fault_in_list(head: str, rest: str, record: Any) -> str | None:
    """Why ``head.rest`` is not a value of a list of ``summary.json`` whose items are of a type; None if it may be one."""
    if rest == "count":
        return None
    number, _, key = rest.partition(".")
    names = [*(part.name for part in fields(record)), *_ENDS.get(head, ())]
    field, _, item = key.partition(".")
    if not number.isdecimal():
        return f"{head} is a list: {head}.count, or {head}.0.KEY with a number and one of {', '.join(names)}"
    if field not in names or (item and not re.fullmatch(r"[\w./-]+", item)):
        return unknown_name(f"key of {head}", field, names)
    return None
