"""``<mimic>`` of a URDF is refused with remedies, and these work."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ffsm_mj.errors import InputError
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from tests.model.test_attached_models import robot
from tests.model.test_own_robot import FILES
from tests.scenes import compile_paths

AXIS = '<axis xyz="0 -1 0"/>'  # of the joint 'nod'
MIMIC = '<mimic joint="swing" multiplier="2"/>'


@pytest.fixture
def otto(tmp_path):
    text = FILES["otto.urdf"]
    assert AXIS in text
    path = tmp_path / "otto.urdf"
    path.write_text(text.replace(AXIS, f"{AXIS}\n{MIMIC}"))
    return path


def test_a_mimic_is_refused_with_both_joints_and_a_remedy(otto):
    line = otto.read_text().splitlines().index(next(text for text in otto.read_text().splitlines() if MIMIC in text)) + 1
    with pytest.raises(InputError) as refused:
        compile_paths(otto)
    (told,) = refused.value.lines
    assert told.startswith(f"{otto}:{line}: joint 'nod' mimics joint 'swing' (<mimic>)")
    assert told.endswith("or write type=\"fixed\" at joint 'nod', or write 'conservative: false' in the scenario")


@pytest.mark.parametrize("cure", [(MIMIC, ""), ('"nod" type="continuous"', '"nod" type="fixed"')])
def test_the_remedies_for_a_mimic_work(otto, cure):
    assert cure[0] in otto.read_text()
    otto.write_text(otto.read_text().replace(*cure))
    system = compile_paths(otto)
    assert not system.faults
    assert len(system.robot.joints) == (3 if cure[1] == "" else 2)


def test_strip_removes_a_mimic(otto):
    system = compile_system(replace(read_model(otto), strip=("equalities",)), {}, time_step_s=1e-3)
    assert not system.faults
    assert len(system.robot.joints) == 3
    assert system.notes[0] == "removed from robot: 1 equality constraint (nod_equality)"


@pytest.mark.parametrize("prefixes", [("a_",), ("left_", "right_")])
def test_a_mimic_of_an_attached_urdf_is_refused_likewise(otto, prefixes):
    """With the names of the joints in the model and the line of the URDF."""
    assets = "".join(f'<model name="{prefix}otto" file="otto.urdf"/>' for prefix in prefixes)
    attach = "".join(f'<attach model="{prefix}otto" body="hub" prefix="{prefix}"/>' for prefix in prefixes)
    (otto.parent / "bus.xml").write_text(robot(assets, attach))
    with pytest.raises(InputError) as refused:
        compile_paths(otto.parent / "bus.xml")
    line = otto.read_text()[: otto.read_text().index(MIMIC)].count("\n") + 1
    for told, prefix in zip(refused.value.lines, prefixes, strict=True):
        assert told.startswith(f"{otto}:{line}: joint '{prefix}nod' mimics joint '{prefix}swing' (<mimic>)")
        assert "write type=\"fixed\" at joint 'nod'" in told
    system = compile_system(replace(read_model(otto.parent / "bus.xml"), strip=("equalities",)), {}, time_step_s=1e-3)
    assert not system.faults
    assert len(system.robot.joints) == 1 + 2 * len(prefixes)


def test_mimics_of_two_urdfs_with_equal_joint_names_are_refused_with_both_places(otto):
    """The names alone are ambiguous."""
    (otto.parent / "anna.urdf").write_text("\n" + otto.read_text())
    names = "otto", "anna"
    assets = "".join(f'<model name="{name}" file="{name}.urdf"/>' for name in names)
    attach = "".join(f'<attach model="{name}" body="hub" prefix="{name}_"/>' for name in names)
    (otto.parent / "bus.xml").write_text(robot(assets, attach))
    with pytest.raises(InputError) as refused:
        compile_paths(otto.parent / "bus.xml")
    line = otto.read_text()[: otto.read_text().index(MIMIC)].count("\n") + 1
    for told, name in zip(refused.value.lines, names, strict=True):
        places, _, rest = told.partition(": joint ")
        assert set(places.split(" or ")) == {f"{otto}:{line}", f"{otto.parent / 'anna.urdf'}:{line + 1}"}
        assert rest.startswith(f"'{name}_nod' mimics joint '{name}_swing'")


def test_a_mimic_of_a_urdf_attached_by_an_attached_model_is_refused_likewise(otto):
    """With the prefixes of both attachments."""
    arm = robot('<model name="otto" file="otto.urdf"/>', '<attach model="otto" body="hub" prefix="a_"/>')
    (otto.parent / "arm.xml").write_text(arm.replace('<freejoint name="float"/>', ""))
    (otto.parent / "bus.xml").write_text(
        robot('<model name="arm" file="arm.xml"/>', '<attach model="arm" body="hub" prefix="b_"/>')
    )
    with pytest.raises(InputError) as refused:
        compile_paths(otto.parent / "bus.xml")
    (told,) = refused.value.lines
    line = otto.read_text()[: otto.read_text().index(MIMIC)].count("\n") + 1
    assert told.startswith(f"{otto}:{line}: joint 'b_a_nod' mimics joint 'b_a_swing' (<mimic>)")


def test_another_constraint_between_the_same_joints_is_no_mimic(otto):
    """A URDF with a <mimic> is attached; the model itself has the inverse constraint."""
    text = robot('<model name="otto" file="otto.urdf"/>', '<attach model="otto" body="hub" prefix="a_"/>')
    own = '<equality><joint joint1="a_swing" joint2="a_nod"/><joint joint1="a_nod"/></equality>'
    (otto.parent / "bus.xml").write_text(text.replace("</mujoco>", f"{own}</mujoco>"))
    with pytest.raises(InputError) as refused:
        compile_paths(otto.parent / "bus.xml")
    assert sorted("(<mimic>)" in line for line in refused.value.lines) == [False, False, True]


def test_a_mimic_stays_a_soft_constraint_if_not_conservative(otto):
    system = compile_paths(otto, {"other": otto}, conservative=False)
    assert system.mj.neq == 2
    following = [fault.partition(" mimics ")[0].rpartition(": ")[2] for fault in system.faults if " mimics " in fault]
    assert following == ["joint 'nod'"] * 2
    # Limits are stops: they do not act as MuJoCo's soft constraints here either.
    assert not any("limits" in fault for fault in system.faults)
