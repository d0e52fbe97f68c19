"""Completion: the scripts are whole, and bash completes with its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from ffsm_mj.cli.command_line import COMMANDS, SHELLS
from ffsm_mj.cli.main import main
from ffsm_mj.scenario.shipped import scenario_names


@pytest.fixture
def script(capsys):
    """Function that gives the script of a shell as the command prints it."""

    def printed(shell):
        assert main(["completion", shell]) == 0
        return capsys.readouterr().out

    return printed


@pytest.fixture
def complete(script, tmp_path):
    """Function that gives what bash offers for the last word of a command line, in a folder with three things in it."""
    (tmp_path / "work" / "my runs").mkdir(parents=True)
    (tmp_path / "work" / "mine.yaml").touch()
    (tmp_path / "work" / "bases").mkdir()
    source = tmp_path / "ffsm.bash"
    source.write_text(script("bash"))

    def offered(*words, **environment):
        code = 'source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _shtab_ffsm; printf "%s\\n" "${COMPREPLY[@]}"'
        command = ["bash", "--norc", "-c", code, "bash", str(source), *words]
        done = subprocess.run(
            command, capture_output=True, text=True, check=True, cwd=tmp_path / "work", env=os.environ | environment
        )
        assert done.stderr == ""
        return done.stdout.split("\n")[:-1]

    return offered


@pytest.mark.parametrize("shell", SHELLS)
def test_a_script_is_whole(script, shell, tmp_path):
    """Its own shell reads it, bash always and the others where they are installed; commands and scenarios stand in it."""
    text = script(shell)
    if shell == "bash" or shutil.which(shell):
        (tmp_path / "script").write_text(text)
        done = subprocess.run([shell, "-n", str(tmp_path / "script")], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
    assert not [word for word in (*COMMANDS, *scenario_names(), "allow-failed-checks") if word not in text]


def test_bash_completes_commands_and_options(complete):
    assert complete("ffsm", "") == list(COMMANDS)
    assert complete("ffsm", "an") == ["analyze"]
    assert complete("ffsm", "run", "--fo") == ["--force"]
    assert complete("ffsm", "export", "--g") == ["--gif"]
    assert complete("ffsm", "completion", "") == list(SHELLS)


def test_bash_completes_scenarios_and_places(complete):
    """A scenario is a shipped name or a file; a run is a file or a folder; figures go to folders."""
    assert complete("ffsm", "run", "base") == ["baseline", "bases"]
    assert complete("ffsm", "check", "mi") == ["mine.yaml"]
    assert complete("ffsm", "run", "-s", "duration_s=5", "free-flying-") == ["free-flying-hardware"]
    assert complete("ffsm", "run", "my r") == ["my runs"]
    assert complete("ffsm", "analyze", "b") == ["bases"]
    assert complete("ffsm", "analyze", "bases", "b") == ["bases"]
    assert complete("ffsm", "analyze", "--plots", "m") == ["my runs"]
    assert complete("ffsm", "run", "baseline", "--out", "m") == ["my runs"]
    assert complete("ffsm", "export", "--csv", "--out", "mi") == ["mine.yaml"]
    assert complete("ffsm", "new", "arm", "--robot", "mi") == ["mine.yaml"]
    assert complete("ffsm", "new", "arm", "--package-path", "m") == ["my runs"]


def test_bash_completes_campaigns_tables_and_folders(complete):
    assert complete("ffsm", "campaign", "run", "base") == ["baseline-dispersed", "bases"]
    assert complete("ffsm", "check", "capture-di") == ["capture-dispersed"]
    assert complete("ffsm", "campaign", "resume", "b") == ["bases"]
    assert complete("ffsm", "campaign", "run", "laws") == ["laws-after-impact"]
    assert complete("ffsm", "campaign", "run", "--metrics", "mi") == ["mine.yaml"]
    assert complete("ffsm", "check", "laws") == ["laws-after-impact"]
    assert complete("ffsm", "export", "--csv", "--table", "imp") == ["impacts"]


@pytest.mark.long
def test_bash_completes_keys_of_the_scenario(complete, tmp_path):
    """By a call of ``ffsm``, which must be on the path: names of its phases, and keys of the kinds that it uses."""
    (tmp_path / "work" / "ffsm").write_text(f'#!/bin/sh\nexec {sys.executable} -m ffsm_mj "$@"\n')
    (tmp_path / "work" / "ffsm").chmod(0o755)
    path = f"{tmp_path / 'work'}{os.pathsep}{os.environ['PATH']}"
    assert complete("ffsm", "run", "baseline", "-s", "dur", PATH=path) == ["duration_s"]
    expected = [f"phases.approach.controller.{key}" for key in ("joints",)]
    assert complete("ffsm", "run", "baseline", "-s", "phases.approach.controller.j", PATH=path) == expected
    assert complete("ffsm", "run", "-s", "task.tar", PATH=path) == ["task.target_m"]
    assert complete("ffsm", "campaign", "run", "capture-dispersed", "-s", "samples.n", PATH=path) == ["samples.n"]


def test_keys_of_a_kind_that_is_not_used_are_not_offered(capsys):
    assert main(["completion", "--keys", "run", "baseline"]) == 0
    keys = capsys.readouterr().out.split()
    assert "phases.regulate.controller.Q" in keys  # of osdre
    assert "phases.regulate.controller.kp" not in keys  # of pd
    assert "initial.joints.joint_1" in keys
    assert len(keys) == len(set(keys)) < 300


def test_a_shell_must_be_named(capsys):
    assert main(["completion"]) == 2
    assert capsys.readouterr().err == "ffsm completion: name a shell: bash, zsh or fish\n"


def test_another_shell_is_refused(capsys):
    assert main(["completion", "tcsh"]) == 2
    assert "invalid choice: 'tcsh' (choose from" in capsys.readouterr().err
