"""``<mimic>`` of a URDF is an equality constraint, whose place is that of the element."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ffsm_mj.dynamics.loops.couplings import JointCoupling, Polynomial
from ffsm_mj.dynamics.loops.equalities import equalities_of
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import read_model
from tests.model.test_attached_models import robot
from tests.model.test_own_robot import FILES
from tests.scenes import compile_paths

AXIS = '<axis xyz="0 -1 0"/>'  # of the joint 'nod'
MIMIC = '<mimic joint="swing" multiplier="2" offset="0.3"/>'


@pytest.fixture
def otto(tmp_path):
    text = FILES["otto.urdf"]
    assert AXIS in text
    path = tmp_path / "otto.urdf"
    path.write_text(text.replace(AXIS, f"{AXIS}\n{MIMIC}"))
    return path


def line_of(path):
    return path.read_text()[: path.read_text().index(MIMIC)].count("\n") + 1


def test_a_mimic_is_a_row_with_its_factor_and_offset(otto):
    system = compile_paths(otto)
    assert not system.faults
    assert list(system.equalities.values()) == [f"{otto}:{line_of(otto)}: <mimic> of joint 'nod' by joint 'swing'"]
    ((_, source),) = equalities_of(system.mj)
    nod, swing = (system.joint(name).dofs.start for name in ("nod", "swing"))
    assert source == JointCoupling(nod, swing, Polynomial(0.0, 0.0, (0.3, 2.0, 0.0, 0.0, 0.0)))


def test_strip_removes_a_mimic(otto):
    system = compile_system(replace(read_model(otto), strip=("equalities",)), {}, time_step_s=1e-3)
    assert not system.equalities
    assert len(system.robot.joints) == 3
    assert system.notes[0] == "removed from robot: 1 equality constraint (nod_equality)"


@pytest.mark.parametrize("prefixes", [("a_",), ("left_", "right_")])
def test_a_mimic_of_an_attached_urdf_has_its_place(otto, prefixes):
    """With the names of the joints in the model and the line of the URDF."""
    assets = "".join(f'<model name="{prefix}otto" file="otto.urdf"/>' for prefix in prefixes)
    attach = "".join(f'<attach model="{prefix}otto" body="hub" prefix="{prefix}"/>' for prefix in prefixes)
    (otto.parent / "bus.xml").write_text(robot(assets, attach))
    assert list(compile_paths(otto.parent / "bus.xml").equalities.values()) == [
        f"{otto}:{line_of(otto)}: <mimic> of joint '{prefix}nod' by joint '{prefix}swing'" for prefix in prefixes
    ]


def test_mimics_of_two_urdfs_with_equal_joint_names_have_both_places(otto):
    """The names alone are ambiguous."""
    (otto.parent / "anna.urdf").write_text("\n" + otto.read_text())
    names = "otto", "anna"
    assets = "".join(f'<model name="{name}" file="{name}.urdf"/>' for name in names)
    attach = "".join(f'<attach model="{name}" body="hub" prefix="{name}_"/>' for name in names)
    (otto.parent / "bus.xml").write_text(robot(assets, attach))
    line = line_of(otto)
    for told, name in zip(compile_paths(otto.parent / "bus.xml").equalities.values(), names, strict=True):
        places, _, rest = told.partition(": <mimic>")
        assert set(places.split(" or ")) == {f"{otto}:{line}", f"{otto.parent / 'anna.urdf'}:{line + 1}"}
        assert rest == f" of joint '{name}_nod' by joint '{name}_swing'"


def test_a_mimic_of_a_urdf_attached_by_an_attached_model_has_its_place(otto):
    """With the prefixes of both attachments."""
    arm = robot('<model name="otto" file="otto.urdf"/>', '<attach model="otto" body="hub" prefix="a_"/>')
    (otto.parent / "arm.xml").write_text(arm.replace('<freejoint name="float"/>', ""))
    (otto.parent / "bus.xml").write_text(
        robot('<model name="arm" file="arm.xml"/>', '<attach model="arm" body="hub" prefix="b_"/>')
    )
    (told,) = compile_paths(otto.parent / "bus.xml").equalities.values()
    assert told == f"{otto}:{line_of(otto)}: <mimic> of joint 'b_a_nod' by joint 'b_a_swing'"


def test_another_constraint_between_the_same_joints_is_no_mimic(otto):
    """A URDF with a <mimic> is attached; the model itself has the inverse constraint."""
    text = robot('<model name="otto" file="otto.urdf"/>', '<attach model="otto" body="hub" prefix="a_"/>')
    own = '<equality><joint joint1="a_swing" joint2="a_nod"/><joint joint1="a_nod"/></equality>'
    (otto.parent / "bus.xml").write_text(text.replace("</mujoco>", f"{own}</mujoco>"))
    told = compile_paths(otto.parent / "bus.xml").equalities.values()
    assert sorted("<mimic>" in each for each in told) == [False, False, True]
