"""The page ``docs/own-robot.md``: its files are written, validated, run and verified; its errors occur."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from tests.scenario.test_scenario import faults

PAGE = (Path(__file__).parents[2] / "docs" / "own-robot.md").read_text()
FILES = dict(re.findall(r"`([\w.]+)`[^`\n]*:\n\n```(?:xml|yaml)\n(.*?)```", PAGE, flags=re.DOTALL))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    assert set(FILES) == {"crab.xml", "rock.xml", "crab.yaml", "otto.urdf", "otto.yaml", "lab.xml"}
    for name, text in FILES.items():
        if name != "lab.xml":  # which a command of the page writes
            (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("name", ["crab", "otto"])
def test_the_page_runs(folder, name, capsys):
    assert len(FILES[f"{name}.yaml"].splitlines()) <= 24
    assert main(["check", f"{name}.yaml"]) == 0
    assert main(["run", f"{name}.yaml", "--no-rerun", "--out", "out"]) == 0
    assert main(["analyze", "out"]) == 0
    run = ffsm_mj.load_run(folder / "out")
    assert len(run.impacts) >= 1
    assert run.unhandled_contacts == ()
    assert [p.name for p in run.phases][:2] == (["reach", "pause"] if name == "crab" else ["reach", "hold"])
    capsys.readouterr()


@pytest.mark.parametrize(
    ("old", "new", "file", "expected"),
    [
        ('<freejoint name="float"/>', "", "crab.xml", "has no joint, so it cannot float"),
        (
            '<motor name="drive a" joint="J-a"/>',
            '<position name="servo" joint="J-a"/>',
            "crab.xml",
            "write 'actuators: {robot/servo: {kind: torque}}'",
        ),
        ("rock/body_joint: [1.9", "rock/body_joint: [1.2", "crab.yaml", "overlap by"),
        ("tip: claw point", "tip: claw_point", "crab.yaml", "(did you mean 'robot/claw point'?)"),
    ],
)
def test_errors_name_a_remedy(folder, old, new, file, expected):
    assert old in FILES[file]
    (folder / file).write_text(FILES[file].replace(old, new))
    lines = faults(path=Path("crab.yaml"))
    assert any(expected in line for line in lines)


def test_friction_and_damping_of_a_urdf_are_kept(folder):
    text = FILES["otto.urdf"].replace('<limit lower="-2"', '<dynamics damping="0.3" friction="0.1"/><limit lower="-2"')
    (folder / "otto.urdf").write_text(text)
    model = prepare("otto.yaml").system.mj
    assert (model.dof_damping.max(), model.dof_frictionloss.max()) == (0.3, 0.1)


@pytest.mark.parametrize(
    "around", [("<gazebo>", "</gazebo>"), ("", ""), ("<ros2_control><hardware>", "</hardware></ros2_control>")]
)
def test_unknown_elements_of_a_urdf_are_ignored(folder, around):
    """As MuJoCo ignores them, including missing files and plugins."""
    told = '<plugin filename="libgazebo_ros_control.so" name="x"/><extension><plugin plugin="no.such"/></extension>'
    text = FILES["otto.urdf"].replace('<robot name="otto">', f'<robot name="otto">{told.join(around)}')
    (folder / "otto.urdf").write_text(text)
    prepared = prepare("otto.yaml")
    assert prepared.system.mj.nplugin == 0
    (folder / "otto.urdf").write_text(FILES["otto.urdf"])
    assert prepare("otto.yaml").system.mj.nbody == prepared.system.mj.nbody


def test_the_recipe_for_a_published_arm(folder, capsys):
    """The commands of the page, in order, write the files that it shows."""
    commands = re.search(r"```\n(ffsm new .*?)```", PAGE, flags=re.DOTALL)[1].splitlines()
    assert [line.split()[:2] for line in commands] == [["ffsm", "new"], ["ffsm", "check"], ["ffsm", "run"]]
    for line in commands:
        assert main(line.split()[1:]) == 0
    capsys.readouterr()
    assert (folder / "lab.xml").read_text() == FILES["lab.xml"]
    (shown,) = re.findall(r"```yaml\n(  sites: .*?)```", PAGE, flags=re.DOTALL)
    assert shown in (folder / "lab.yaml").read_text()
    run = ffsm_mj.load_run("logs/latest")
    assert [record.geoms[1] for record in run.impacts] == ["ball/ball"]
    assert all(check.passes for check in all_checks(run))
