"""A package with a control law to start from: it runs, passes its own test, and nothing is written over."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib

import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.templates.law import write_law

MODULE_FINDER = """
import importlib.util, sys

class Finder:
    @staticmethod
    def find_spec(name, path=None, target=None):
        return importlib.util.spec_from_file_location(name, {place!r}) if name == {module!r} else None

sys.meta_path.append(Finder)
"""


def as_installed(home, module):
    """The environment in which a package is found as after ``pip install -e``.

    Setuptools puts ``src`` on the path where ``package-dir`` says that modules are there. A module that stands beside
    ``pyproject.toml`` it finds by a finder of its own that comes last, after everything on the path, the working directory
    too.
    """
    stated = tomllib.loads((home / "pyproject.toml").read_text())
    path = home.with_name(f"{module}-installed")
    path.mkdir()
    place = stated["tool"]["setuptools"].get("package-dir", {}).get("")
    if place is None:
        (path / "sitecustomize.py").write_text(MODULE_FINDER.format(place=str(home / f"{module}.py"), module=module))
    info = path / f"{module}-0.1.0.dist-info"
    info.mkdir()
    ((kind, target),) = stated["project"]["entry-points"]["ffsm_mj.controllers"].items()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 0.1.0\n")
    (info / "entry_points.txt").write_text(f"[ffsm_mj.controllers]\n{kind} = {target}\n")
    return os.environ | {"PYTHONPATH": os.pathsep.join(map(str, [path] if place is None else [path, home / place]))}


@pytest.mark.long
def test_a_new_law_passes_its_own_test(tmp_path, capfd):
    """Under its own name, from its own folder and from the one beside; with its line of the law reversed the test fails."""
    assert main(["new-law", "joint_brake", "--out", str(tmp_path)]) == 0
    home = tmp_path / "joint_brake"
    said = capfd.readouterr().out
    names = ["README.md", "joint_brake.yaml", "pyproject.toml", "src/joint_brake.py", "test_joint_brake.py"]
    assert sorted(str(path.relative_to(home)) for path in home.rglob("*") if path.is_file()) == names
    assert all(name in said for name in names)
    text = "".join((home / name).read_text() for name in names)
    assert "my_law" not in text.lower().replace("-", "_")
    assert "class JointBrake(Stateful):" in text
    environment = as_installed(home, "joint_brake")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "0", str(home)]
    done = subprocess.run(command, env=environment, cwd=home, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed" in done.stdout
    beside = "import ffsm_mj; print(ffsm_mj.run('joint_brake/joint_brake.yaml', {'duration_s': 0.01}).outcome)"
    done = subprocess.run(
        [sys.executable, "-c", beside], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "completed\n"), done.stderr
    law = home / "src" / "joint_brake.py"
    law.write_text(law.read_text().replace("-self._gain * rates", "self._gain * rates"))
    assert subprocess.run(command, env=environment, cwd=home, capture_output=True, check=False).returncode == 1


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("My", "not a module name"),
        ("9x", "not a module name"),
        ("a/b", "not a module name"),
        ("", "not a module name"),
        ("pd", "already the name of a control law"),
    ],
)
def test_names_that_cannot_be(tmp_path, name, fault):
    with pytest.raises(InputError, match=fault):
        write_law(name, tmp_path, ("pd", "off"))
    assert not any(tmp_path.iterdir())


def test_nothing_is_written_over(tmp_path, capfd):
    (tmp_path / "mine").mkdir()
    assert main(["new-law", "mine", "--out", str(tmp_path)]) == 2
    assert capfd.readouterr().err == f"new-law: {tmp_path / 'mine'} exists; nothing is written over it\n"
