"""The names of ``ffsm_mj``: seen by ``dir``, by completion and by type checkers, imported when they are used."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import ffsm_mj

PACKAGE = Path(ffsm_mj.__file__).parent


def python(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_dir_has_the_public_names_and_imports_nothing():
    code = """
import sys, ffsm_mj
print([name for name in dir(ffsm_mj) if not name.startswith("__")] == sorted(ffsm_mj.__all__))
print({"numpy", "mujoco", "pydantic"} & set(sys.modules))
"""
    assert python(code) == ["True", "set()"]


def test_completion_in_a_session_knows_them():
    code = """
import rlcompleter, ffsm_mj
completer = rlcompleter.Completer({"ffsm_mj": ffsm_mj})
print(completer.complete("ffsm_mj.load", 0))
print(completer.complete("ffsm_mj.Sce", 0))
"""
    assert python(code) == ["ffsm_mj.load_run(", "ffsm_mj.Scenario("]


def test_the_version_is_that_of_the_package():
    code = """
import sys, ffsm_mj
from importlib.metadata import version
print(ffsm_mj.__version__ == version("ffsm-mj"), "__version__" in dir(ffsm_mj))
"""
    assert python(code) == ["True True"]


def test_type_checkers_read_the_same_names():
    """The imports that only they see are ``__all__``, from where ``__getattr__`` takes them."""
    assert (PACKAGE / "py.typed").is_file()
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    typed = {
        alias.asname: (node.module, alias.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert typed == {name: (module, name) for name, module in ffsm_mj._LAZY.items()} | {"impact": ("ffsm_mj", "impact")}
    assert sorted(typed) == sorted(ffsm_mj.__all__)
