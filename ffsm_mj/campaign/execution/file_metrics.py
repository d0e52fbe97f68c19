"""Metrics of a Python file that is no package: each public function of it is a metric of the function's name."""

from __future__ import annotations

import ast
import hashlib
import linecache
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import InputError, described, raised_at


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
    functions = {each.name: each for each in tree.body if isinstance(each, ast.FunctionDef) and each.name[0] != "_"}
    if not functions:
        raise InputError(f"{path}: defines no metric: a function of a run without a leading underscore in its name")
    for name, each in functions.items():
        given = each.args
        needed = len(given.posonlyargs) + len(given.args) - len(given.defaults)
        if needed != 1 or any(default is None for default in given.kw_defaults):
            raise InputError(
                f"{path}:{each.lineno}:{each.col_offset + 1}: {name} is no metric: a metric has one argument, the "
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


@lru_cache(maxsize=4)
def _module(file: str, text: str) -> ModuleType:
    """Module of a file, executed once per process and content."""
    module = ModuleType(f"ffsm_metrics_{hashlib.sha256(text.encode()).hexdigest()[:12]}")
    module.__file__ = file
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)  # tracebacks show its lines
    sys.modules[module.__name__] = module  # dataclasses look their module up
    exec(compile(text, file, "exec"), module.__dict__)
    return module
