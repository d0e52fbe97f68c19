"""Prototypes of MuJoCo's functions in the core: one that mujoco.h does not have does not compile."""

from __future__ import annotations

import re
import subprocess
import sys
import sysconfig
from pathlib import Path
from shutil import copytree, which

import mujoco
import pytest

CORE = Path(__file__).parents[2] / "ffsm_mj" / "_core"

pytestmark = pytest.mark.skipif(which("cc") is None, reason="no C compiler")


@pytest.fixture
def copy(tmp_path):
    """The module that calls MuJoCo by address and MuJoCo's headers, to be changed."""
    copytree(Path(mujoco.__file__).parent / "include", tmp_path / "include")
    (tmp_path / "ffsm_mj/_core").mkdir(parents=True)
    (tmp_path / "ffsm_mj/__init__.py").touch()
    for name in ("__init__.py", "functions.pyx", "functions.pxd", "functions.h"):
        (tmp_path / "ffsm_mj/_core" / name).write_bytes((CORE / name).read_bytes())
    return tmp_path


def changed(path, changes):
    text = path.read_text()
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    path.write_text(text)


def translate(folder):
    """From Cython to C."""
    subprocess.run([sys.executable, "-m", "cython", "ffsm_mj/_core/functions.pyx"], cwd=folder, check=True)


def refused(folder):
    """What the C compiler says of it."""
    places = ("include", sysconfig.get_path("include"), sysconfig.get_path("platinclude"))
    command = ["cc", "-fsyntax-only", *(f"-I{place}" for place in places), "ffsm_mj/_core/functions.c"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    complaints = re.findall('error: static assertion failed: "(.*)"', done.stderr)
    assert (done.returncode == 0) == (not complaints), done.stderr
    return complaints


@pytest.mark.long
def test_a_header_that_changes_is_noticed(copy):
    """The prototypes fit mujoco.h as it is, not one with an argument less and one of another type."""
    translate(copy)
    assert refused(copy) == []
    changed(
        copy / "include/mujoco/mujoco.h",
        [
            ("void mj_mulM(const mjModel* m, const mjData* d, mjtNum* res,", "void mj_mulM(const mjModel* m, mjtNum* res,"),
            ("void mj_solveM(const mjModel* m, mjData* d,", "void mj_solveM(const mjModel* m, mjtSize d,"),
        ],
    )
    assert refused(copy) == ["mujoco.h declares mj_mulM otherwise", "mujoco.h declares mj_solveM otherwise"]


@pytest.mark.long
def test_a_wrong_prototype_does_not_compile(copy):
    """Another type, an argument less, const lost, another result; and a function that would get no address."""
    changed(
        copy / "ffsm_mj/_core/functions.pxd",
        [
            ("int skipstage, int skipsensor)", "int skipstage)"),
            ("void (*checkPos)", "int (*checkPos)"),
            ("const double* y, int n)", "const double* y, double n)"),
            ("(*jacDot)(const mjModel* m, const mjData* d,", "(*jacDot)(const mjModel* m, mjData* d,"),
            ("Functions:\n", "Functions:\n    void (*inverse)(const mjModel* m, mjData* d) noexcept nogil\n"),
        ],
    )
    translate(copy)
    nameless, *others = refused(copy)
    assert nameless == "Functions has a member that functions.h does not name"
    assert others == [f"mujoco.h declares mj_{name} otherwise" for name in ("forwardSkip", "checkPos", "solveM", "jacDot")]
