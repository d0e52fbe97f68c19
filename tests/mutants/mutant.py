"""Mistakes in the engine, put in on purpose: patches of source, applied to a copy of the product that then runs.

Modules of the core that a patch changes are compiled again.

A mutant is a YAML file of this folder::

    wrong: What is wrong, in a sentence.
    scene: bounces                      # a function of tests/mutants/scenes.py
    caught_by: [impact restitution]     # checks of ``ffsm analyze`` that fail, all of them
    patch:
      - file: ffsm_mj/contact_models/impact/laws.py
        replace: text that the file has once
        by: other text

``ends_with: 3`` in place of ``caught_by`` is the exit code of a run that does not come to its end, ``cannot: reason`` says
why no check sees it; every check then passes. ``test: tests/...::test_...`` in place of a scene is a test that fails, for
mistakes of geometry that a run makes in agreement with itself.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from shutil import copy2, copytree
from typing import Any

import pytest
from ruamel.yaml import YAML

from hatch_build import CORE, build
from tests.mutants import scenes

ROOT = Path(__file__).parents[2]
PARTS = ("ffsm_mj", "controllers", "mjcf", "scenarios")
"""Folders of the product that a run needs."""
REPLAY = {"motion": "replay of the motion", "columns": "replay of columns", "impacts": "replay of events"}
"""Names for what ``ffsm analyze`` compares with the log, by those in its JSON."""

# One process for both commands, as most of the time is that of imports. What ``run`` prints is for the message of a failure.
_RUN_AND_ANALYZE = """
import contextlib, sys
import ffsm_mj
from ffsm_mj.cli.main import main
product, scenario, folder = sys.argv[1:]
assert ffsm_mj.__file__.startswith(product), ffsm_mj.__file__
with contextlib.redirect_stdout(sys.stderr):
    code = main(["run", scenario, "--out", folder, "--no-rerun"])
if code not in (0, 1, 5):
    sys.exit(code)
sys.exit(main(["analyze", folder, "--json"]))
"""
# The package is imported before pytest puts the folder of the tests, which has another one, in front of all paths.
_TEST = """
import sys
import ffsm_mj, pytest
product, root, test = sys.argv[1:]
assert ffsm_mj.__file__.startswith(product), ffsm_mj.__file__
sys.exit(pytest.main(["-n", "0", "-q", "--long", "-p", "no:cacheprovider", "--rootdir", root, f"{root}/{test}"]))
"""


@dataclass(frozen=True)
class Edit:
    """A text that a file has once, and what it is replaced by."""

    file: str
    replace: str
    by: str

    def changed(self, text: str) -> str:
        """The text of the file with the edit; fails if it does not apply."""
        found = text.count(self.replace)
        assert found == 1, f"the patch does not apply: {self.file} has {found} times\n{self.replace}"
        return text.replace(self.replace, self.by)


@dataclass(frozen=True)
class Mutant:
    """See the module."""

    name: str
    wrong: str
    patch: tuple[Edit, ...]
    scene: str = ""
    test: str = ""
    caught_by: tuple[str, ...] = ()
    ends_with: int = 0
    cannot: str = ""

    @property
    def seen_by(self) -> str:
        """The checks that see it, how the run ends, why none does, or the test that fails."""
        if self.ends_with:
            return f"the run, which ends with exit code {self.ends_with}"
        if self.test:
            return f"`{self.test}`"
        return ", ".join(f"*{check}*" for check in self.caught_by) or f"none: {self.cannot}"

    def apply(self, product: Path) -> None:
        """Change the sources of a copy of the product, whose files may be links."""
        for edit in self.patch:
            path = product / edit.file
            text = edit.changed(path.read_text())
            path.unlink()
            path.write_text(text)
        if core := {Path(edit.file).stem for edit in self.patch if Path(edit.file).parent == CORE}:
            build(product, core)


def mutants() -> list[Mutant]:
    """All mutants, by name."""
    return [_read(path) for path in sorted(Path(__file__).parent.glob("*.yaml"))]


def _read(path: Path) -> Mutant:
    data: dict[str, Any] = YAML(typ="safe", pure=True).load(path)
    data |= {"patch": tuple(Edit(**edit) for edit in data["patch"]), "caught_by": tuple(data.get("caught_by", ()))}
    mutant = Mutant(path.stem, **data)
    ways = sum(map(bool, (mutant.caught_by, mutant.ends_with, mutant.cannot, mutant.test)))
    assert ways == 1, f"{path.name}: needs one of 'caught_by', 'ends_with', 'cannot' and 'test'"
    return mutant


def copy_product(folder: Path) -> Path:
    """Copy what runs: sources with their bytecode, models and scenarios."""
    for part in PARTS:
        copytree(ROOT / part, folder / part, copy_function=link)
    return folder


def link(source: str, target: str) -> None:
    """Link a file, or copy it with its times to another file system."""
    try:
        os.link(source, target)
    except OSError:
        copy2(source, target)


def failing_checks(product: Path, scene: str, folder: Path) -> tuple[int, set[str]]:
    """Run a scene with a copy of the product, and analyse the log with the same copy.

    Returns:
        The exit code of ``ffsm analyze``, or of ``ffsm run`` if that does not come to its end, and the names of the checks
        that fail by more than truncation.
    """
    folder.mkdir()
    scenario = getattr(scenes, scene)(folder)
    done = _python(_RUN_AND_ANALYZE, product, folder, str(scenario), str(folder / "run"))
    if not done.stdout and done.returncode > 1:
        return done.returncode, set()
    assert done.stdout, done.stderr
    result = json.loads(done.stdout)
    assert not result["states"]["obstacle"], result["states"]
    failing = {check["check"] for check in result["checks"] if not check["passes"] and not check["fails_by_truncation"]}
    compared = result["states"]["worst"].items()
    return done.returncode, failing | {REPLAY[part] for part, one in compared if not one["difference"] <= one["allowed"]}


def passes(product: Path, test: str, folder: Path) -> bool:
    """Whether a test passes with a copy of the product; it must run."""
    folder.mkdir()
    done = _python(_TEST, product, folder, str(ROOT), test)
    assert done.returncode in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED), done.stdout + done.stderr
    return done.returncode == pytest.ExitCode.OK


def _python(program: str, product: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a program, whose first argument is the product, with a copy of the product."""
    path = os.pathsep.join((str(product), str(product / "controllers")))
    environment = {**os.environ, "PYTHONPATH": path}
    environment.pop("PYTHONPYCACHEPREFIX", None)  # the copy has bytecode of its own
    command = [sys.executable, "-c", program, str(product), *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
