"""The build of the core, and what is said where it cannot be made or used."""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import mujoco
import pytest

import ffsm_mj
import hatch_build
from ffsm_mj._core import BUILT
from ffsm_mj.cli.main import main
from tests.scenes import two_balls


def hook(target="wheel"):
    return hatch_build.CustomBuildHook(".", {}, None, None, "", target)


def test_version_log_and_check_name_the_core(tmp_path, capsys):
    assert f"MuJoCo {'.'.join(mujoco.__version__.split('.')[:2])}, " in BUILT
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.endswith(f", core for {BUILT}\n")
    path = two_balls(tmp_path, duration_s=0.01)
    assert main(["check", str(path)]) == 0
    assert f"core: {BUILT}" in capsys.readouterr().out.splitlines()
    assert ffsm_mj.run(path).log.header.metadata["version core"] == BUILT


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize(
    ("before", "reason"),
    [
        (
            "import mujoco; mujoco.mj_version, mujoco.__version__ = lambda: 4001002, '4.1.2'",
            "ImportError: built for MuJoCo 4.0, not 4.1.2",
        ),
        ("sys.modules['ffsm_mj._core.functions'] = None", "import of ffsm_mj._core.functions halted"),
    ],
    ids=["another MuJoCo", "no core"],
)
def test_a_core_that_cannot_be_used_is_one_line(tmp_path, before, reason):
    """Before anything is called by address, with the way out."""
    command = "from ffsm_mj.cli.main import main; sys.exit(main(['run', 'coasting', '--no-rerun']))"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; {before}; {command}"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.startswith("the compiled core of ffsm-mj cannot be used (")
    assert reason in done.stderr
    assert "; build it again: " in done.stderr
    assert done.stderr.count("\n") == 1


def test_without_a_compiler_one_comes_from_a_package(monkeypatch):
    """Asked for by the build of a wheel, and only then."""
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert hook().dependencies() == ["ziglang"]
    assert hook("sdist").dependencies() == []
    monkeypatch.setenv("CC", "my-cc -m64")
    assert hook().dependencies() == []
    assert hatch_build._compiler() == ["my-cc", "-m64"]


def test_missing_headers_of_python_are_one_line(monkeypatch, tmp_path):
    """With both ways out."""
    monkeypatch.setattr(sysconfig, "get_paths", lambda: {"include": str(tmp_path)})
    both = r"^ffsm-mj: Python.h is not in .*apt install python3-dev.*uv run --managed-python"
    with pytest.raises(SystemExit, match=both):
        hatch_build.build(Path(__file__).parents[2])
