"""Control laws of other packages: the documented example as it stands, and a broken one."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks

DOC = Path(__file__).parents[2] / "docs" / "own-controller.md"


def install(folder: Path, module: str, code: str, entry: str, group: str = "controllers") -> dict[str, str]:
    """What ``pip install`` leaves: a module and a dist-info with an entry point. Returns the environment to run in."""
    folder.mkdir(exist_ok=True)
    (folder / f"{module}.py").write_text(code)
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[ffsm_mj.{group}]\n{entry}\n")
    return os.environ | {"PYTHONPATH": str(folder)}


def ffsm(environment, *arguments):
    command = [sys.executable, "-m", "ffsm_mj.cli.main", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def example():
    """(python, toml, yaml) blocks of the page."""
    blocks = dict(re.findall(r"```(python|toml|yaml)\n(.*?)```", DOC.read_text(), flags=re.DOTALL))
    ((name, place),) = tomllib.loads(blocks["toml"])["project"]["entry-points"]["ffsm_mj.controllers"].items()
    entry = f"{name} = {place}"
    return blocks["python"], entry, blocks["yaml"]


@pytest.mark.long
def test_the_documented_example_runs(tmp_path, example):
    code, entry, phases = example
    environment = install(tmp_path, "my_laws", code, entry)
    (tmp_path / "mine.yaml").write_text(f"extends: coasting\nname: mine\n{phases}")
    out = tmp_path / "out"
    changes = ("-s", "duration_s=2", "--no-rerun", "--out")
    done = ffsm(environment, "run", str(tmp_path / "mine.yaml"), *changes, str(out))
    assert done.returncode == 0, done.stderr
    run = ffsm_mj.load_run(out)
    rate = run["controller.damp_rate_rad_s"]
    assert abs(rate[-1]) < 0.5 * abs(rate[0])
    assert all(check.passes for check in all_checks(run))
    assert run.summary()["controller"]["phases"][0]["reports"] == {"last_rate_rad_s": rate[-1]}
    assert set(re.findall(r"^from (ffsm_mj\S*) import", code, flags=re.MULTILINE)) == {"ffsm_mj.controller_protocol"}
    # The same without a summary, which a law may leave out.
    code = re.sub(r"\n    def summary.*", "", code, flags=re.DOTALL)
    ffsm(
        install(tmp_path / "silent", "my_laws", code, entry),
        "run",
        str(tmp_path / "mine.yaml"),
        *changes,
        str(out),
        "--force",
    )
    assert ffsm_mj.load_run(out).summary()["controller"]["phases"][0]["reports"] == {}


UNKNOWN_TYPE = """
from typing import Literal

from ffsm_mj.controller_protocol import StrictModel

class Gain:
    pass

class Law:
    class Config(StrictModel):
        kind: Literal["broken"]
        gain: Gain
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import nothing_like_this\n", "cannot be used (ModuleNotFoundError: No module named 'nothing_like_this')"),
        (UNKNOWN_TYPE, "cannot be used (Pydantic"),
        ("class Law: pass\n", "broken_laws:Law has no class attribute Config"),
    ],
    ids=["cannot be imported", "config cannot be built", "no config"],
)
def test_a_broken_plugin_harms_only_who_asks_for_it(tmp_path, code, message):
    environment = install(tmp_path, "broken_laws", code, "broken = broken_laws:Law")
    assert ffsm(environment, "check", "baseline").returncode == 0
    done = ffsm(environment, "check", "baseline", "-s", "phases.1.controller={kind: broken}")
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert message in line
    assert "the plugin for kind 'broken'" in line
    assert "usable: off, pd, osdre, free_flying" in line


@pytest.mark.long
def test_a_plugin_that_fails_when_it_is_made_is_a_fault_of_the_phase(tmp_path, example):
    code, entry, phases = example
    code = code.replace("        model = context.system.mj\n", '        raise RuntimeError("no licence")\n')
    (tmp_path / "mine.yaml").write_text(f"extends: coasting\nname: mine\n{phases}")
    done = ffsm(install(tmp_path, "my_laws", code, entry), "check", str(tmp_path / "mine.yaml"))
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith(f"{tmp_path}/mine.yaml:6:")
    assert line.endswith("phases.0.controller.kind: the controller cannot be made (RuntimeError: no licence)")


@pytest.mark.long
@pytest.mark.parametrize(
    ("signal", "fault"),
    [
        ('Signal("state", "time_s", "s", "mine")', "'state.time_s' is no name in the group controller"),
        ('Signal("controller", "my rate", "rad/s", "mine")', "'controller.my rate' is no name in the group controller"),
        ('Signal("controller", "damp_rate_rad_s", "rad/s", "mine")', "controller.damp_rate_rad_s is listed twice"),
        ('"damp_rate_rad_s"', "telemetry_signals is no sequence of Signal"),
    ],
)
def test_telemetry_that_cannot_be_columns_is_a_fault_of_the_phase(tmp_path, example, signal, fault):
    """Before, it was written over another column, or the run ended in a traceback."""
    code, entry, phases = example
    code = code.replace('"rate that is damped"),\n', f'"rate that is damped"),\n        {signal},\n')
    (tmp_path / "mine.yaml").write_text(f"extends: coasting\nname: mine\n{phases}")
    done = ffsm(install(tmp_path, "my_laws", code, entry), "check", str(tmp_path / "mine.yaml"))
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert f"phases.0.controller.kind: telemetry of kind 'damp': {fault}" in line


@pytest.mark.long
@pytest.mark.parametrize(
    ("group", "override", "message"),
    [
        ("controllers", "phases.1.controller={kind: off}", "phases.1.controller.kind: the plugin for kind 'off'"),
        ("impact_laws", "impact.law=blend", "impact.law: the impact law 'blend' of an installed package"),
        ("contact_models", "contact_models=[{kind: impact}]", "kind: the contact model 'impact' of an installed package"),
    ],
)
def test_an_entry_point_with_the_name_of_a_built_in_class_is_refused(tmp_path, group, override, message):
    """The scenario says which of the two it wants by the name alone."""
    name = {"controllers": "off", "impact_laws": "blend", "contact_models": "impact"}[group]
    environment = install(tmp_path, "same_names", "class Law: pass\n", f"{name} = same_names:Law", group)
    done = ffsm(environment, "check", "baseline", "-s", override)
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert f"{message} cannot be used (same_names:Law has the name of a built-in " in line


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
