"""Properties of bodies and geoms given in a scenario: MuJoCo compiles them to the given values, or they are refused."""

from __future__ import annotations

import dataclasses
import functools
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.dynamics.rigid_body import mass_matrix
from ffsm_mj.errors import InputError, ScenarioFaults
from ffsm_mj.log.scenario import compile_log
from ffsm_mj.model import overrides as overrides_of
from ffsm_mj.model.composition import compile_system
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.properties import BodyProperties, Inertial, Overrides, property_value
from ffsm_mj.pytest_plugin import assert_conserved
from ffsm_mj.scenario.shipped import scenario_names
from ffsm_mj.yaml import plain_value, write_yaml
from tests.model.repeated import repeated
from tests.scenes import ARM, HEAD, ball, scene, two_balls

FULL = '<inertial mass="3" pos="0.1 0 0.2" fullinertia="0.1 0.2 0.15 0.01 0.02 0.03"/>'
DIAGONAL = '<inertial mass="3" pos="0.1 0 0.2" euler="20 30 40" diaginertia="0.1 0.2 0.15"/>'
GEOM = '<geom name="hull" type="box" size="0.1 0.2 0.3" mass="4"/>'
MODELS = {
    "inferred": f"<body name='b'><freejoint/>{GEOM}</body>",
    "explicit": f"<body name='b'><freejoint/>{DIAGONAL}{GEOM}</body>",
    "full inertia": f"<body name='b'><freejoint/>{FULL}{GEOM}</body>",
    "flat": "<body name='b'><freejoint/><inertial mass='3' pos='0 0 0' diaginertia='0.1 0.2 0.3'/></body>",
    "inertiafromgeom": f"<body name='b'><freejoint/>{DIAGONAL}{GEOM}</body>",
    "boundmass": f"<body name='b'><freejoint/>{GEOM}<body name='c' pos='1 0 0'><joint/>{DIAGONAL}</body></body>",
    "balanceinertia": "<body name='b'><freejoint/><inertial mass='3' pos='0 0 0' diaginertia='0.1 0.2 0.9'/></body>",
    "frames and copies": f"""<frame pos='1 2 3' euler='10 20 30'><body name='b'><freejoint/>{GEOM}
      <frame pos='0.1 0 0' euler='0 45 0'><geom name='rod' type='capsule' size='0.05' fromto='0 0 0 0.3 0.4 0.1'/>
      <body name='c' pos='0 0 0.5' euler='5 6 7'><joint axis='0 1 0'/>{DIAGONAL}</body></frame>
      <replicate count='3' euler='0 0 120'><body name='leg' pos='0.4 0 0'><joint axis='1 0 0'/>
      <geom name='foot' type='ellipsoid' size='0.1 0.05 0.02'/></body></replicate></body></frame>""",
    "fusestatic": f"<body name='b'><freejoint/>{GEOM}<body name='c' pos='1 0 0'>{DIAGONAL}</body></body>",
}
COMPILER = {
    "inertiafromgeom": 'inertiafromgeom="true"',
    "boundmass": 'boundmass="8" boundinertia="0.5"',
    "balanceinertia": 'balanceinertia="true"',
    "fusestatic": 'fusestatic="true"',
}
ASKED = {"mass_kg": 7.0}
_OTHER = "not a scenario of this version"


def mjcf(kind):
    return f"<mujoco><compiler {COMPILER.get(kind, '')}/>{HEAD}<worldbody>{MODELS[kind]}</worldbody></mujoco>"


def compiled(text, *layers, **more):
    """Compile a scene of one model with layers of properties by body."""
    files = ModelFiles("robot.xml", {"robot.xml": text.encode()} | {name: other.encode() for name, other in more.items()})
    layers = [
        Overrides("model", {name: BodyProperties.model_validate(body) for name, body in layer.items()}) for layer in layers
    ]
    return compile_system(dataclasses.replace(files, overrides=tuple(layers)), {}, time_step_s=1e-3)


def arrays(model):
    return {name: value for name in dir(model) if isinstance(value := getattr(model, name, None), np.ndarray)}


def assert_same(model, other):
    """Compare two compiled models bit by bit."""
    for name, value in arrays(model).items():
        np.testing.assert_array_equal(value, getattr(other, name), err_msg=name)


@pytest.mark.parametrize("kind", MODELS)
def test_explicit_inertials_change_nothing(kind):
    """Bit by bit, for every way to give an inertia: only then is a change exactly the given one."""
    assert_same(compiled(mjcf(kind)).mj, compiled(mjcf(kind), {"b": {}}).mj)


@pytest.mark.long
@pytest.mark.parametrize("scenario", scenario_names())
def test_explicit_inertials_change_nothing_in_what_is_shipped(scenario):
    prepared = prepare(scenario)
    bodies = [name.split("/") for name in prepared.system.names("body") if not name.endswith("/world")]
    given = prepared.scenario.model
    same = prepare(scenario, {f"model.{tree}.{body}": {} for tree, body in bodies if body not in given.get(tree, {})})
    assert len(same.scenario.model) > 0
    assert_same(prepared.system.mj, same.system.mj)


@pytest.mark.parametrize("kind", MODELS)
def test_a_mass_scales_the_inertia(kind):
    before, after = (Inertial.of(system.mj, 1) for system in (compiled(mjcf(kind)), compiled(mjcf(kind), {"b": ASKED})))
    assert after.mass_kg == 7.0 != before.mass_kg
    # One rounding of the factor, one of the product.
    np.testing.assert_allclose(after.moments, before.moments * 7.0 / before.mass_kg, rtol=4e-16)
    np.testing.assert_array_equal(after.axes, before.axes)
    np.testing.assert_array_equal(after.centre_m, before.centre_m)


@pytest.mark.parametrize("kind", ["inertiafromgeom", "boundmass", "balanceinertia", "fusestatic"])
def test_a_mass_in_an_attached_model(kind):
    """The attached file has its own compiler settings."""
    main = f"""<mujoco>{HEAD}<asset><model name="sub" file="sub.xml"/></asset><worldbody>
      <body name="root"><freejoint/>{GEOM.replace("hull", "top")}<attach model="sub" body="b" prefix="p_"/></body>
      </worldbody></mujoco>"""
    sub = mjcf(kind).replace("<freejoint/>", "<joint axis='0 1 0'/>")
    before, after = compiled(main, **{"sub.xml": sub}), compiled(main, {"p_b": ASKED}, **{"sub.xml": sub})
    assert property_value(after.mj, "model.robot.p_b.mass_kg") == 7.0
    others = [i for i in range(1, before.mj.nbody) if before.mj.body(i).name != "robot/p_b"]
    np.testing.assert_array_equal(after.mj.body_mass[others], before.mj.body_mass[others])
    np.testing.assert_array_equal(after.mj.body_inertia[others], before.mj.body_inertia[others])


def test_a_mass_in_a_urdf():
    urdf = """<robot name="r"><link name="hub"><inertial><origin xyz="0.1 0 0" rpy="0.1 0.2 0.3"/><mass value="4"/>
      <inertia ixx="3" iyy="4" izz="3.5" ixy="0.1" ixz="0" iyz="0.2"/></inertial></link>
      <joint name="j" type="continuous"><parent link="hub"/><child link="arm"/><axis xyz="0 0 1"/></joint>
      <link name="arm"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
      </link></robot>"""
    files = ModelFiles("r.urdf", {"r.urdf": urdf.encode()})
    wanted = Overrides(
        "model", {"hub": BodyProperties(mass_kg=8.0), "arm": BodyProperties(centre_of_mass_m=(0.3, 0.0, 0.0))}
    )
    before = compile_system(files, {}, time_step_s=1e-3)
    after = compile_system(dataclasses.replace(files, overrides=(wanted,)), {}, time_step_s=1e-3)
    assert after.mj.body_mass.tolist() == [0.0, 8.0, 2.0]
    np.testing.assert_array_equal(after.mj.body_inertia[1], 2.0 * before.mj.body_inertia[1])
    assert property_value(after.mj, ("model", "robot", "arm", "centre_of_mass_m")) == (0.3, 0.0, 0.0)
    assert after.notes == before.notes


@pytest.mark.parametrize(
    "inertia", [[0.2, 0.3, 0.4], [0.2, 0.3, 0.4, 0.05, -0.02, 0.01], [0.3, 0.1, 0.4], [1e-6, 2e-6, 2e-6]]
)
@pytest.mark.parametrize("kind", ["inferred", "full inertia", "inertiafromgeom"])
def test_an_inertia_is_that_about_the_centre_of_mass_in_the_axes_of_the_body(kind, inertia):
    """Compared with the mass matrix of a free joint, whose angular block is about the body's origin, in its axes."""
    asked = {"mass_kg": 2.0, "inertia_kg_m2": inertia, "centre_of_mass_m": [0.1, -0.2, 0.3]}
    system = compiled(mjcf(kind), {"b": asked})
    data = mujoco.MjData(system.mj)
    mujoco.mj_forward(system.mj, data)
    xx, yy, zz, xy, xz, yz = (*inertia, 0.0, 0.0, 0.0)[:6]
    c = np.array(asked["centre_of_mass_m"])
    about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + 2.0 * (c @ c * np.eye(3) - np.outer(c, c))
    M = mass_matrix(system.mj, data)
    # Rounding of sums of a few products of size 1, and of an eigendecomposition and its inverse.
    np.testing.assert_allclose(M[3:6, 3:6], about_origin, atol=1e-14)
    np.testing.assert_array_equal(M[:3, :3], 2.0 * np.eye(3))
    told = property_value(system.mj, "model.robot.b.inertia_kg_m2")
    np.testing.assert_allclose(told, [xx, yy, zz, xy, xz, yz], atol=1e-15)


def test_flat_bodies_of_any_mass_compile():
    """Their greatest moment is the sum of the others: by rounding, MuJoCo would refuse half of all masses."""
    for mass in np.random.default_rng(3).uniform(0.1, 50.0, 60).tolist():
        system = compiled(mjcf("flat"), {"b": {"mass_kg": mass}})
        np.testing.assert_allclose(system.mj.body_inertia[1], np.array([0.1, 0.2, 0.3]) * mass / 3.0, rtol=1e-15)


def test_sizes_keep_the_mass_without_mass_from_geoms():
    size = {"geoms": {"hull": {"size_m": [0.2, 0.2, 0.3]}}}
    kept, own = compiled(mjcf("inferred"), {"b": size}).mj, compiled(mjcf("inferred")).mj
    assert kept.geom_size[0].tolist() == [0.2, 0.2, 0.3]
    np.testing.assert_array_equal(kept.body_inertia, own.body_inertia)
    dense = mjcf("explicit").replace('mass="4"', 'density="1000"')
    new = compiled(dense, {"b": size | {"mass_from_geoms": True}})
    mass = 1000.0 * 8.0 * 0.2 * 0.2 * 0.3
    moments = mass / 3.0 * np.array([0.2**2 + 0.3**2, 0.2**2 + 0.3**2, 2 * 0.2**2])
    # MuJoCo orders moments as it likes where axes are its own choice.
    np.testing.assert_allclose(property_value(new.mj, "model.robot.b.inertia_kg_m2"), [*moments, 0, 0, 0], atol=1e-13)
    assert new.mj.body_mass[1] == pytest.approx(mass, rel=1e-14)
    assert new.mj.body_ipos[1].tolist() == [0.0, 0.0, 0.0]
    both = compiled(dense, {"b": size | {"mass_from_geoms": True, "mass_kg": 2.0}}).mj
    assert both.body_mass[1] == 2.0
    np.testing.assert_allclose(both.body_inertia[1], new.mj.body_inertia[1] * 2.0 / mass, rtol=1e-14)


def test_bodies_with_mass_from_boundmass_only_compile():
    """Without ``boundmass`` the tool has no mass, and MuJoCo would refuse the model."""
    tool = "<body name='tool' pos='1 0 0'><joint/></body>"
    text = f"<mujoco><compiler boundmass='0.5' boundinertia='0.1'/>{HEAD}<worldbody><body name='b'><freejoint/>{GEOM}{tool}"
    system = compiled(f"{text}</body></worldbody></mujoco>", {"b": {"mass_from_geoms": True}}, {"b": ASKED})
    assert system.mj.body_mass.tolist() == [0.0, 7.0, 0.5]


def test_a_capsule_given_by_its_ends_stays_between_them():
    own, other = compiled(ARM).mj, compiled(ARM, {"upper": {"geoms": {"upper": {"size_m": [0.03, 0.22]}}}}).mj
    geom = own.geom("robot/upper").id
    assert other.geom_size[geom, :2].tolist() == [0.03, 0.22]
    for name in ("geom_pos", "geom_quat"):
        np.testing.assert_allclose(getattr(other, name)[geom], getattr(own, name)[geom], atol=1e-16)


def test_a_capsule_given_by_its_ends_in_a_frame():
    text = mjcf("frames and copies")
    own = compiled(text).mj
    rod = own.geom("robot/rod").id
    size = property_value(own, "model.robot.b.geoms.rod.size_m")
    same = compiled(text, {"b": {"geoms": {"rod": {"size_m": list(size)}}}, "leg1": {"mass_kg": 3.0}}).mj
    assert property_value(same, "model.robot.leg1.mass_kg") == 3.0
    np.testing.assert_array_equal(same.geom_pos[rod], own.geom_pos[rod])
    np.testing.assert_allclose(same.geom_quat[rod], own.geom_quat[rod], atol=4e-16)


def test_a_visual_geom_has_a_size_too():
    """The scene ignores ``discardvisual`` of a model, so the geom exists."""
    seen = f"<body name='b'><freejoint/>{GEOM}<geom name='look' size='0.1' contype='0' conaffinity='0'/></body>"
    text = f"<mujoco><compiler discardvisual='true'/>{HEAD}<worldbody>{seen}</worldbody></mujoco>"
    (change,) = compiled(text, {"b": {"geoms": {"look": {"size_m": [0.2]}}}}).changes
    assert (change.before, change.after) == ((0.1,), (0.2,))


def test_a_body_whose_frame_mujoco_aligns_keeps_it_where_only_its_geoms_change():
    text = mjcf("explicit").replace("<freejoint/>", '<freejoint align="true"/>')
    own, sized = compiled(text).mj, compiled(text, {"b": {"geoms": {"hull": {"size_m": [0.2, 0.2, 0.2]}}}}).mj
    assert_same(own, compiled(text, {"b": {}}).mj)
    for name in ("body_quat", "body_pos", "body_ipos", "body_inertia", "geom_pos", "geom_quat"):
        np.testing.assert_array_equal(getattr(sized, name), getattr(own, name))


def test_a_layer_starts_from_the_one_below():
    below, above = {"b": {"inertia_kg_m2": [1.0, 1.0, 1.0], "mass_kg": 2.0}}, {"b": {"mass_kg": 4.0}}
    system = compiled(mjcf("inferred"), below, above)
    assert system.mj.body_inertia[1].tolist() == [2.0, 2.0, 2.0]
    changes = {change.path[-1]: (change.before, change.after) for change in system.changes}
    assert changes["mass_kg"] == (2.0, 4.0)
    assert changes["inertia_kg_m2"][1] == (2.0, 2.0, 2.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("kept", ["inertiafromgeom", "boundmass", "inferred"])
def test_a_mass_that_mujoco_ignores_is_detected(monkeypatch, kept):
    """Setting the mass alone gives an error, not a run with other values."""
    monkeypatch.setattr(Inertial, "write", lambda self, body: setattr(body, "mass", self.mass_kg))
    with pytest.raises(ScenarioFaults, match=r"MuJoCo compiles it to [48], not 7") as error:
        compiled(mjcf(kept), {"b": ASKED})
    assert error.value.faults[0].path == ("model", "robot", "b", "mass_kg")


def test_a_changed_inertial_of_another_body_is_detected(monkeypatch):
    own = Inertial.write

    def write(self, body):
        own(dataclasses.replace(self, mass_kg=5.0) if body.name == "c" else self, body)

    monkeypatch.setattr(Inertial, "write", write)
    with pytest.raises(ScenarioFaults, match=r"mass or inertia of body .c. would change too"):
        compiled(mjcf("fusestatic"), {"b": ASKED})


def test_a_size_that_mujoco_ignores_is_detected(monkeypatch):
    monkeypatch.setattr(overrides_of, "_put_size", lambda *_: None)
    with pytest.raises(ScenarioFaults, match=r"MuJoCo compiles it to \[0.1, 0.2, 0.3\], not \[1, 1, 1\]"):
        compiled(mjcf("inferred"), {"b": {"geoms": {"hull": {"size_m": [1.0, 1.0, 1.0]}}}})


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (
            {"trget": {"target": ASKED}},
            r"model\.trget: unknown model 'trget' \(did you mean 'target'\?\); allowed: robot, target",
        ),
        ({"target": {"targt": ASKED}}, r"model\.target\.targt: unknown body 'targt' .*allowed: target"),
        ({"target": {"world": ASKED}}, r"model\.target\.world: unknown body 'world'; allowed: target"),
        ({"target": {"target": {"mass_kg": 0.0}}}, r"model\.target\.target\.mass_kg: should be greater than 0, got 0"),
        ({"target": {"target": {"mass_kg": -1.0}}}, r"model\.target\.target\.mass_kg: should be greater than 0"),
        ({"target": {"target": {"mass_kg": 1e300}}}, r"mass_kg: should be less than or equal to 1"),
        ({"target": {"target": {"mass": 1.0}}}, r"model\.target\.target\.mass: unknown key .*allowed: .*mass_kg"),
        (
            {"target": {"target": {"inertia_kg_m2": [1, 1, 3]}}},
            r"greatest principal moment must not exceed the sum of the others: 1, 1, 3",
        ),
        ({"target": {"target": {"inertia_kg_m2": [1, 1, 1, 2, 0, 0]}}}, r"must have positive principal moments"),
        ({"target": {"target": {"inertia_kg_m2": [1, 1, 1, 2]}}}, r"must be 3 numbers \(xx, yy, zz\) or 6"),
        ({"target": {"target": {"centre_of_mass_m": [1, 1]}}}, r"centre_of_mass_m: should have at least 3 items"),
        (
            {"target": {"target": {"geoms": {"x": {"size_m": [1]}}}}},
            r"geoms\.x: unknown geom of the body 'x'; allowed: target",
        ),
        (
            {"target": {"target": {"geoms": {"target": {"size_m": [1, 2]}}}}},
            r"size_m: the size of a sphere has 1 number, got 2",
        ),
        ({"target": {"target": {"geoms": {"target": {"size_m": [0]}}}}}, r"size_m\.0: should be greater than 0"),
        (
            {"target": {"target": {"mass_from_geoms": True}}},
            r"model\.target: mass_from_geoms: MuJoCo finds no mass in the geoms",
        ),
        ({"target": {"target": {"mass_kg": 1e-17}}}, r"model\.target: MuJoCo refuses the model with these properties: "),
    ],
)
@pytest.mark.parametrize("key", ["model", "controller_model"])
def test_invalid_properties_give_one_line_with_their_place(tmp_path, key, asked, said):
    path = two_balls(tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: asked}))
    with pytest.raises(InputError, match=r"scene\.yaml:1:\d+: .*" + said.replace(r"model\.", rf"{key}\.", 1)) as error:
        prepare(path)
    assert len(error.value.lines) == 1
    assert main(["check", str(path)]) == 2


def test_properties_without_effect_are_refused(tmp_path):
    wall = f"<mujoco>{HEAD}<worldbody><geom name='wall' type='box' size='0.1 1 1'/></worldbody></mujoco>"
    path = scene(tmp_path, ball(), {"wall": wall, "mesh": ball("mesh")}, fixed={"wall": {"position_m": [2, 0, 0]}})
    with pytest.raises(
        InputError, match=r"model\.wall\.world\.mass_kg: it is fixed: its mass has no effect; remove the key"
    ):
        prepare(path, {"model.wall.world.mass_kg": 3})
    system = prepare(path, {"model.wall.world.geoms.wall.size_m": [0.2, 1, 1]}).system
    assert property_value(system.mj, "model.wall.world.geoms.wall.size_m") == (0.2, 1.0, 1.0)
    static = mjcf("inferred").replace("</worldbody>", '<body name="lamp"><geom name="lamp" size="1"/></body></worldbody>')
    with pytest.raises(ScenarioFaults, match="the body does not move: its mass has no effect"):
        compiled(static, {"lamp": ASKED})
    aligned = mjcf("explicit").replace("<freejoint/>", '<freejoint align="true"/>')
    with pytest.raises(ScenarioFaults, match="MuJoCo aligns the frame of this body with its inertia"):
        compiled(aligned, {"b": ASKED})
    empty = "<body name='b'><freejoint/>" + GEOM + "<body name='tool'/></body>"
    with pytest.raises(ScenarioFaults, match="no mass to scale its inertia with; give both mass_kg and inertia_kg_m2"):
        compiled(f"<mujoco>{HEAD}<worldbody>{empty}</worldbody></mujoco>", {"tool": ASKED})
    plane = '<body name="b"><freejoint/>' + DIAGONAL + '<geom name="p" type="mesh" mesh="m"/></body>'
    mesh = '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>'
    with pytest.raises(ScenarioFaults, match="a mesh has no size of its own; kinds that have one: sphere"):
        compiled(f"<mujoco>{HEAD}{mesh}<worldbody>{plane}</worldbody></mujoco>", {"b": {"geoms": {"p": {"size_m": [1.0]}}}})


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("model.robot.b", "is not a property; write"),
        ("model.robot.x.mass_kg", "unknown body 'robot/x'"),
        ("model.robot.b.mass", "unknown property 'mass'"),
        ("model.robot.b.geoms.x.size_m", "unknown geom 'robot/x'"),
    ],
)
def test_values_are_found_by_name(path, said):
    with pytest.raises(LookupError, match=said):
        property_value(compiled(mjcf("inferred")).mj, path)


def impulse(m1, m2, e, speed):
    """Impulse of a central impact of two bodies, N s."""
    return m1 * m2 / (m1 + m2) * (1.0 + e) * speed


@pytest.mark.parametrize(("m1", "m2"), [(2.0, 3.0), (7.0, 3.0), (0.5, 30.0)])
def test_the_impulse_is_that_of_the_masses(tmp_path, m1, m2):
    path = two_balls(tmp_path, restitution=0.6)
    run = ffsm_mj.run(path, [f"model.robot.ball.mass_kg={m1}", f"model.target.target.mass_kg={m2}"])
    assert run.impacts[0].impulse_N_s == pytest.approx(impulse(m1, m2, 0.6, 1.0), rel=1e-14)
    assert_conserved(run)


@pytest.mark.parametrize("radius", [0.05, 0.1, 0.17])
def test_a_size_moves_the_time_of_contact(tmp_path, radius):
    """Centres 0.5 m apart approach at 1 m/s; the ball of the robot has a radius of 0.1 m."""
    path = two_balls(tmp_path)
    run = ffsm_mj.run(path, {"model.target.target.geoms.target.size_m": [radius]})
    # Time of impact is found to where the gap is 1e-12 m or so.
    assert run.impacts[0].time_s == pytest.approx(0.4 - radius, abs=1e-11)
    assert run.impacts[0].impulse_N_s == pytest.approx(impulse(2.0, 3.0, 1.0, 1.0), rel=1e-14)


def test_log_replay_and_rerun_have_the_properties_too(tmp_path, capfd):
    out = tmp_path / "run"
    given = ["model.robot.ball.mass_kg=5", "model.target.target={mass_kg: 2, geoms: {target: {size_m: [0.2]}}}"]
    path = two_balls(tmp_path, restitution=0.5)
    run, logged = repeated(path, out, overrides=given)
    assert not np.array_equal(run.log.rows, ffsm_mj.run(path).log.rows)
    expected = {
        "robot": {"ball": {"mass_kg": 5.0}},
        "target": {"target": {"mass_kg": 2.0, "geoms": {"target": {"size_m": [0.2]}}}},
    }
    assert json.loads((out / "summary.json").read_text())["model"] == expected
    assert "model" not in ffsm_mj.run(path).summary()
    assert_same(logged.mj, prepare(path, given).system.mj)
    printed = capfd.readouterr().out
    assert "columns agree with states" in printed
    told = ["robot.ball.mass_kg = 5", "target.target.mass_kg = 2", "target.target.geoms.target.size_m = [0.2]"]
    assert {f"model.{line}" for line in told} <= set(printed.splitlines())


def test_check_lists_the_properties(tmp_path, capfd):
    assert main(["check", str(two_balls(tmp_path)), "-s", "model.robot.ball.mass_kg=5"]) == 0
    assert "    model.robot.ball.mass_kg is 5; without it 2" in capfd.readouterr().out


@pytest.fixture(scope="module")
def changed(tmp_path_factory):
    """The log of a run with a site, a fixed object and a property that its scenario gives."""
    path = scene(
        tmp_path_factory.mktemp("changed"),
        ball("ball"),
        {"port": f"<mujoco>{HEAD}<worldbody><geom size='1'/></worldbody></mujoco>"},
        fixed={"port": {"position_m": [0, 0, 9]}},
        duration_s=0.01,
    )
    return ffsm_mj.run(path, {"model.robot.ball.mass_kg": 5, "robot.sites": {"tip": {"body": "ball"}}}).log


@pytest.mark.parametrize(
    ("place", "wrong", "said"),
    [
        ("model", 5, _OTHER),
        ("model", {"nobody": {}}, _OTHER),
        ("model.robot", 3, _OTHER),
        ("model.robot.ball.mass_kg", -1, _OTHER),
        ("model.robot.ball", 3, _OTHER),
        ("model.robot.nobody", {}, "unknown body 'nobody'"),
        ("robot.sites.tip.body", "nobody", "unknown body 'nobody'"),
        ("robot.sites.tip.pos_m", [float("nan"), 0, 0], _OTHER),
        ("robot.sites.tip.pos_m", 5, _OTHER),
        ("robot.sites.tip.body", 7, _OTHER),
        ("robot.sites.tip", "ball", _OTHER),
        ("objects.port.pose.position_m", [0.0, 0.0], _OTHER),
        ("objects.port.pose.position_m", [0.0, float("nan"), 0.0], _OTHER),
        ("objects.port.pose.position_m", "nowhere", _OTHER),
    ],
)
def test_a_log_with_invalid_entries_is_refused_in_one_line(changed, place, wrong, said):
    data = plain_value(changed.header.scenario_yaml)
    *keys, last = place.split(".")
    functools.reduce(dict.__getitem__, keys, data)[last] = wrong
    with pytest.raises(InputError, match=f"the log: .*{said}") as refused:
        compile_log(dataclasses.replace(changed, header=dataclasses.replace(changed.header, scenario=write_yaml(data))))
    assert len(refused.value.lines) == 1


def test_a_scenario_that_extends_changes_one_property_of_many(tmp_path):
    parent = two_balls(tmp_path, model={"robot": {"ball": {"mass_kg": 5, "centre_of_mass_m": [0, 0, 0.01]}}})
    child = tmp_path / "child.yaml"
    child.write_text(f"extends: {parent.name}\nname: child\nmodel: {{robot: {{ball: {{mass_kg: 6}}}}}}\n")
    changes = prepare(child).system.changes
    assert {change.path[-1]: change.after for change in changes} == {"mass_kg": 6.0, "centre_of_mass_m": (0.0, 0.0, 0.01)}


def test_every_model_is_prepared_by_one_function():
    """Its parts are called nowhere else.

    Exceptions are files from which a scenario is written, meshes to be decomposed, shapes that stand for pieces of
    unions and for cones, of which MuJoCo is asked for distances, and a scene of MuJoCo's own contacts to compare with.
    """
    allowed = {
        "contact/probe.py",
        "model/composition.py",
        "model/decompose.py",
        "model/source.py",
        "scenario/models.py",
        "templates/vendor.py",
        "validation/measured/tossing.py",
        "verification/independent/shapes.py",
    }
    package = Path(ffsm_mj.__file__).parent
    makers = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if any(word in path.read_text() for word in ("load_spec(", "load_completely(", "MjSpec(", "from_xml", ".attach("))
    }
    assert makers == allowed
