"""A user's own package called ``controllers``, in the working directory and first on the path, is in nobody's way."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

LIBRARY = """
import controllers, ffsm_controllers, ffsm_mj
assert controllers.MINE == 42
assert "off" in ffsm_controllers.kinds().classes
print(ffsm_mj.run("baseline", {"duration_s": 0.01}).outcome)
"""


@pytest.fixture
def python(tmp_path):
    """Runs Python where a folder ``controllers`` comes before everything that is installed."""
    (tmp_path / "controllers").mkdir()
    (tmp_path / "controllers" / "__init__.py").write_text("MINE = 42\n")

    def run(*arguments):
        environment = os.environ | {"PYTHONPATH": str(tmp_path)}
        command = [sys.executable, *arguments]
        return subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)

    return run


@pytest.mark.long
def test_the_library_and_the_users_package_side_by_side(python):
    done = python("-c", LIBRARY)
    assert (done.returncode, done.stdout) == (0, "completed\n"), done.stderr


@pytest.mark.long
def test_the_commands(python, tmp_path):
    assert python("-m", "ffsm_mj.cli.main", "check", "baseline").returncode == 0
    changes = ("-s", "duration_s=0.01", "--no-rerun", "--out", "out")
    done = python("-m", "ffsm_mj.cli.main", "run", "baseline", *changes)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "run.mcap").is_file()
