"""Commands in messages work where the user typed the present one: the program, the options, what installs something."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ffsm_mj import installation, invocation


@pytest.fixture
def typed(monkeypatch, tmp_path):
    """A folder of programs on the path; the messages are read on the command line, outside a checkout."""
    (tmp_path / "bin").mkdir()
    for name in ("ffsm", "python3"):
        (tmp_path / "bin" / name).touch(mode=0o755)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.chdir(tmp_path)
    with invocation.command_line():
        yield tmp_path / "bin"


def test_the_program_is_named_as_it_was_called(typed, tmp_path):
    """By its name alone only where the shell finds the same file under it."""
    python = str(typed / "python3")
    assert invocation.program([python, str(typed / "ffsm"), "run", "ffsm"]) == "ffsm"
    assert invocation.program([python, "-m", "ffsm_mj", "run"]) == "python3 -m ffsm_mj"
    assert invocation.program(["/opt/a b/python", "-m", "ffsm_mj.cli.main"]) == "'/opt/a b/python' -m ffsm_mj.cli.main"
    (tmp_path / "venv").mkdir()
    (tmp_path / "venv" / "ffsm").touch()
    assert invocation.program([python, "venv/ffsm", "run"]) == "venv/ffsm"
    assert invocation.program([python, "-m", "pytest", "tests"]) == "ffsm"


def test_under_uv_the_project_is_named_where_uv_would_not_find_it(typed, tmp_path, monkeypatch):
    monkeypatch.setenv("UV_RUN_RECURSION_DEPTH", "1")
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "my checkout" / ".venv"))
    (tmp_path / "my checkout" / "below").mkdir(parents=True)
    (tmp_path / "my checkout" / "pyproject.toml").touch()
    words = [str(typed / "python3"), str(typed / "ffsm"), "run"]
    assert invocation.program(words) == f"uv run --project '{tmp_path}/my checkout' ffsm"
    monkeypatch.chdir(tmp_path / "my checkout" / "below")
    assert invocation.program(words) == "uv run ffsm"
    (tmp_path / "my checkout" / "below" / "pyproject.toml").touch()  # a project in between
    assert "--project" in invocation.program(words)


@pytest.mark.usefixtures("typed")
def test_options_are_written_for_the_command_line():
    assert (invocation.option("force", "True"), invocation.override("a=1")) == ("--force", "-s a=1")
    assert invocation.command("view", "logs/a b").endswith("view 'logs/a b'")


def test_options_are_written_in_python_elsewhere():
    assert (invocation.option("force", "True"), invocation.override("a=1")) == ("force=True", "overrides: a=1")


@pytest.fixture
def environment(tmp_path, monkeypatch):
    """An environment of uv or of Python beside a project, at ``sys.prefix``."""

    def made(by_uv: bool, project: str) -> Path:
        prefix = tmp_path / "project" / ".venv"
        prefix.mkdir(parents=True)
        (prefix / "pyvenv.cfg").write_text("home = /usr\n" + "uv = 0.13\n" * by_uv)
        (prefix.parent / "pyproject.toml").write_text(f'[project]\nname = "{project}"\n')
        monkeypatch.setattr(sys, "prefix", str(prefix))
        monkeypatch.setattr(sys, "executable", str(prefix / "bin" / "python"))
        monkeypatch.delenv("VIRTUAL_ENV", raising=False)
        monkeypatch.chdir(prefix.parent)
        return prefix

    return made


def test_an_extra_is_added_and_nothing_is_removed(environment, monkeypatch):
    """``uv sync --extra`` without ``--inexact`` would remove the user's own control law."""
    environment(True, "ffsm-mj")
    assert installation.add_extra("html", "k3d") == "uv sync --inexact --extra html"
    monkeypatch.setenv("UV_RUN_RECURSION_DEPTH", "1")
    monkeypatch.setattr(sys, "argv", ["ffsm", "export", "logs/a b", "--html"])
    with invocation.command_line():
        assert installation.add_extra("html", "k3d") == "uv run --extra html ffsm export 'logs/a b' --html"


def test_elsewhere_the_package_is_installed(environment, monkeypatch, tmp_path):
    prefix = environment(True, "another-project")
    assert installation.add_extra("html", "k3d") == "uv pip install k3d"
    monkeypatch.chdir(tmp_path)
    assert installation.add("k3d") == f"uv pip install --python {prefix}/bin/python k3d"
    monkeypatch.setenv("VIRTUAL_ENV", str(prefix))
    assert installation.add("k3d") == "uv pip install k3d"
    monkeypatch.setenv("UV_RUN_RECURSION_DEPTH", "1")  # uv has set VIRTUAL_ENV for this process, not for the user's shell
    assert "--python" in installation.add("k3d")


def test_without_uv_pip_installs_it(environment):
    prefix = environment(False, "ffsm-mj")
    assert installation.add_extra("html", "k3d") == f"{prefix}/bin/python -m pip install k3d"


@pytest.mark.long
def test_the_module_is_a_program(tmp_path):
    """``python -m ffsm_mj``; its hints begin so too."""
    command = [sys.executable, "-m", "ffsm_mj", "run", "coasting", "-s", "duration_s=0.01", "--no-rerun", "--out", "a"]
    environment = {key: value for key, value in os.environ.items() if key != "UV_RUN_RECURSION_DEPTH"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "-m ffsm_mj view a" in done.stdout
