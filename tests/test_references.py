"""What docstrings and pages refer to is there: modules, classes, functions, and files by their path."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = {"ffsm_mj": ROOT / "ffsm_mj", "ffsm_controllers": ROOT / "controllers" / "ffsm_controllers"}
PAGES = [
    *ROOT.glob("*.md"),
    *(ROOT / "docs").glob("*.md"),
    ROOT / "pyproject.toml",
    ROOT / ".ci" / "run",
]
SOURCES = [path for folder in (*PACKAGES.values(), ROOT / "tests", ROOT / "benchmarks") for path in folder.rglob("*.py")]
ROLE = re.compile(r":(?:mod|class|func|meth|attr):`~?([\w.]+)`")
DOTTED = re.compile(r"\b(?:ffsm_mj|ffsm_controllers)(?:\.\w+)+")
FILE = re.compile(r"(?<![\w./<>$-])((?:[\w.-]+/)+[\w-]+\.(?:py|pyx|pxd|md|xml|yaml))\b")


EXAMPLES = {
    "a/b.xml",
    "../logs/base/scenario.yaml",
    "examples/dem/3d-oblique-wall-impact/oblique_wall_impact_postprocessing.py",  # of a copy of other people's data
}


def lookup(target: str) -> bool:
    """Whether a dotted name leads to a module, or to a name or field in one."""
    parts = target.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:cut]))
        except ImportError:
            continue
        for name in parts[cut:]:
            if not hasattr(found, name):
                return name == parts[-1] and name in told_attributes(found)
            found = getattr(found, name)
        return True
    return False


def told_attributes(found: object) -> set[str]:
    """Attributes that only instances have: those that a class annotates or tells in its docstring."""
    classes = getattr(found, "__mro__", ())
    annotated = {name for cls in classes for name in getattr(cls, "__annotations__", {})}
    return annotated | {name for cls in classes for name in re.findall(r"^ +(\w+): ", cls.__doc__ or "", re.MULTILINE)}


def places(target: str, module: str, *, package: bool) -> list[str]:
    """Where a name may stand that a docstring of a module refers to: anywhere, in the module, or in a class of it."""
    if target.startswith("."):
        return [(module if package else module.rpartition(".")[0]) + target]
    classes = [name for name, value in vars(importlib.import_module(module)).items() if isinstance(value, type)]
    return [target, f"{module}.{target}", *(f"{module}.{name}.{target}" for name in classes)]


@pytest.mark.parametrize(("name", "folder"), PACKAGES.items())
def test_roles_in_docstrings_resolve(name, folder):
    lost, count = [], 0
    for path in folder.rglob("*.py"):
        parts = path.relative_to(folder).with_suffix("").parts
        package = path.name == "__init__.py"
        module = ".".join((name, *(parts[:-1] if package else parts)))
        for target in ROLE.findall(path.read_text()):
            count += 1
            if not any(map(lookup, places(target, module, package=package))):
                lost.append(f"{path.relative_to(ROOT)}: {target}")
    assert count > 1
    assert not lost


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_dotted_names_on_pages_resolve(page):
    text = re.sub(
        r"ffsm_mj\.(controllers|estimators|impact_laws|metrics|rewards)\b", "", page.read_text()
    )  # entry-point groups
    assert not [name for name in DOTTED.findall(text) if not lookup(name)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_pages_name_are_there(page):
    assert not missing(page.read_text(), page.parent)


def test_files_that_sources_name_are_there():
    lost = {}
    for path in SOURCES:
        if path.is_relative_to(ROOT / "tests"):
            continue  # tests name files that they make
        names = [name for name in missing(path.read_text(), path.parent) if ".py" in name]
        if names:
            lost[str(path.relative_to(ROOT))] = names
    assert not lost


def missing(text: str, here: Path) -> list[str]:
    """Files that a text names and that are neither in the checkout, in the library, nor beside the text."""
    folders = (ROOT, *PACKAGES.values(), ROOT / "controllers", here)
    named = [name for name in FILE.findall(text) if name not in EXAMPLES]
    return [name for name in named if not any((folder / name).is_file() for folder in folders)]
