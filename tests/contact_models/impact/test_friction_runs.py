"""Runs with friction: balances, records, checks from the log, and contacts with friction that would persist."""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.main import main
from ffsm_mj.contact_models.impact import model as contact_model
from ffsm_mj.contact_models.impact.records import IMPACT
from ffsm_mj.errors import InputError
from ffsm_mj.log.scenario import compile_log, scenario_data
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.replay import replay_log
from ffsm_mj.report.record_tables import impact_table
from ffsm_mj.verification import impact_checks
from tests.changed_logs import with_records
from tests.contact_models import scenes as contact_model_scenes
from tests.contact_models.grasp import scenes as grasps
from tests.contact_models.impact.test_fixed import slab
from tests.replays import proved
from tests.scenes import ball, box, scene

OFF_CENTRE = {
    "joints": {"box/free": [0.6, 0.1, 0.05, 1, 0, 0, 0]},
    "rates": {"robot/free": [1, 0.2, 0.1, 1, 2, 3], "box/free": [0, 0.1, 0, 0.3, 1, 2]},
}
FLAT = {"joints": {"box/free": [0.6, 0.1, 0.05, 1, 0, 0, 0]}, "rates": {"box/free": [-1, 0.3, 0, 2, 0, 0]}}


def off_centre(folder, e=0.5, mu=0.3, **scenario):
    """A spinning ball meets a tumbling box off its centre, at one point."""
    pair = {"between": ["ball", "box/box"], "restitution": e, "mu": mu}
    return scene(
        folder,
        ball("ball", mass=2.0),
        {"box": box("box", mass=3.0, half=(0.2, 0.3, 0.25))},
        **{"initial": OFF_CENTRE, "contacts": {"rules": [pair]}, "duration_s": 0.4} | scenario,
    )


def flat(folder, e=0.5, mu=0.3, **scenario):
    """A box that spins about the common normal meets a slab, face on face."""
    pair = {"between": ["slab", "box/box"], "restitution": e, "mu": mu}
    return scene(
        folder,
        box("slab", mass=5.0, half=(0.1, 1, 1)),
        {"box": box("box", mass=2.0, half=(0.2, 0.3, 0.25))},
        **{"initial": FLAT, "contacts": {"rules": [pair]}, "duration_s": 0.4} | scenario,
    )


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """One contact, from its log on disk."""
    folder = tmp_path_factory.mktemp("one")
    ffsm_mj.run(off_centre(folder), out=folder / "run", rerun=False)
    return ffsm_mj.load_run(folder / "run")


@pytest.fixture(scope="module")
def several(tmp_path_factory):
    """Four contacts at one instant, from their log on disk."""
    folder = tmp_path_factory.mktemp("several")
    ffsm_mj.run(flat(folder), out=folder / "run", rerun=False)
    return ffsm_mj.load_run(folder / "run")


@pytest.mark.parametrize("which", ["one", "several"])
def test_checks_from_the_log(which, request):
    """Momenta by subsystem including friction, energy, and the heat, which is minus the work of friction."""
    run = proved(request.getfixturevalue(which))
    hits = run.impacts
    assert {hit.law for hit in hits} == {"stronge" if which == "one" else "coulomb"}
    work = sum(hit.friction_work_J for hit in hits)
    assert run["balance.friction_heat_J"][-1] == pytest.approx(-work, rel=1e-9)
    assert work < 0.0
    assert "impact restitution" not in {check.name for check in all_checks(run)}
    pushed = sum(hit.impulse_N_s * np.array(hit.normal) + hit.tangential_impulse_N_s for hit in hits)
    column = [run[f"balance.contact_P_{x}_N_s"][-1] for x in "xyz"]
    np.testing.assert_allclose(column, pushed, atol=1e-14)
    about = np.sum([hit.angular_impulse_N_m_s for hit in hits], axis=0)  # on the box about its centre, from inside its frame
    index = [run.keys.index(f"momentum.objects_L_{x}_N_m_s") for x in "xyz"]
    after = np.searchsorted(run.time, hits[0].time_s)
    jump = run.log.rows[after, index] - run.log.rows[after - 1, index]
    centre = np.array(hits[0].qpos[-7:-4])
    np.testing.assert_allclose(jump, about + np.cross(centre, pushed), atol=1e-12)


def changed(value):
    """A number changed by one millionth of itself and a little more."""
    return value + 1e-6 * (1.0 + abs(value))


def impact_energy_check(run, **wrong):
    """The check of impact energy with a changed record."""
    records = (replace(run.impacts[0], **wrong), *run.impacts[1:])
    log = with_records(run.log, {"impacts": records})
    (law,) = (check for check in all_checks(Run(log)) if check.name == "impact energy")
    return law


NOT_JUDGED = {  # by this law; ``analyze`` compares every field with what the states say
    *(
        "event",
        "time_s",
        "step",
        "pair",
        "rule",
        "geoms",
        "robot_geom",
        "object_geom",
        "manifold",
        "restitution",
        "efforts_after",
    ),
    *("dropped_gap_m", "dropped_flights_s", "angular_impulse_N_m_s", "gap_m", "momentum_before", "momentum_after"),
    *("linear_momentum_change_N_s", "angular_momentum_change_N_m_s"),
}
OF_ONE = {"status", "law", "theta", "mu", "restitution_used", "compression_work_J", "path"}
"""For several contacts only the sums are checked: the distribution of the works over them is a convention."""


@pytest.mark.long
@pytest.mark.parametrize("which", ["one", "several"])
@pytest.mark.parametrize("field", sorted({each.name for each in fields(ImpactRecord)} - NOT_JUDGED))
def test_one_falsified_number_fails_the_check(which, field, request):
    run = request.getfixturevalue(which)
    (hit, *_) = run.impacts
    value = getattr(hit, field)
    assert impact_energy_check(run).passes
    if isinstance(value, str):
        wrong = [value + "x"]
    elif isinstance(value, float):
        wrong = [changed(value)]
    elif isinstance(value, dict):
        names = {"total"} if field.startswith("energy") else value  # its parts are in the balances of the subsystems
        wrong = [value | {name: (changed(value[name][0]), *value[name][1:])} for name in names]
    else:
        wrong = [(*value[:i], changed(value[i]), *value[i + 1 :]) for i in range(len(value))]
        wrong = wrong[: len(wrong) if field != "qpos" else 0] or [tuple(changed(x) for x in value)]
    for each in wrong:
        assert impact_energy_check(run, **{field: each}).passes is (which == "several" and field in OF_ONE)


def test_energy_gain_fails_the_check(several):
    """Everything but the energy agrees: 1e-11 of T too much, a hundredth of the general tolerance."""
    hit = several.impacts[0]
    judge = impact_checks.FrictionCheck(several.log, lambda: (compile_log(several.log), scenario_data(several.log)))
    met = judge._met(several.impacts)
    energy = hit.energy_before_J["total"][0]
    grown = met.before * math.sqrt(1.0 + 1e-11)
    judge._met = lambda _: replace(met, after=grown)
    miss = judge.worst(several.impacts, 1e-9)
    assert miss.excess > 1.0
    judge._met = lambda _: replace(met, after=grown, before=grown)
    assert energy > 0.0


def test_records_of_friction(one):
    (hit,) = one.impacts
    (summary,) = one.summary()["impacts"]
    assert {"mu": 0.3, "law": "stronge", "status": "ok", "theta": 1.0}.items() <= summary.items()
    assert summary["tangential_impulse_N_s"] == list(hit.tangential_impulse_N_s)
    assert hit.path == "slip, stick"
    assert ", mu = 0.3, friction impulse 0.1415 N s, slip 0.2907 to " in IMPACT.sentence(hit)
    normal, across = IMPACT.marks(hit)
    assert normal.direction == hit.normal
    np.testing.assert_allclose(np.array(across.direction) * across.magnitude, hit.tangential_impulse_N_s, atol=1e-15)
    assert abs(np.dot(across.direction, hit.normal)) < 1e-14
    head, units, _ = impact_table(one.impacts).splitlines()
    assert head.split()[4:8] == ["mu", "approach", "impulse", "friction"]
    assert units.split() == ["s", "m/s", "N", "s", "N", "s", "J", "N", "s", "N", "m", "s"]
    closed = impact_table([replace(hit, approach_speed_m_s=-1e-18)]).splitlines()[2]
    assert "  0.000000  " in closed  # and no minus sign
    table = one.table("impacts")
    assert table.columns["tangential_impulse_z_N_s"][0] == hit.tangential_impulse_N_s[2]


def test_a_smooth_pair_beside_a_rough_one(tmp_path):
    """The impact of the smooth pair is that of a scene without friction, bit for bit."""
    third = {"initial": OFF_CENTRE, "duration_s": 0.4}
    pairs = [{"between": ["ball", "box/box"], "restitution": 0.5}, {"between": ["box/box", "far/far"], "mu": 0.5}]
    objects = {"box": box("box", mass=3.0, half=(0.2, 0.3, 0.25)), "far": ball("far")}
    place = {"joints": OFF_CENTRE["joints"] | {"far/free": [9, 9, 9, 1, 0, 0, 0]}, "rates": OFF_CENTRE["rates"]}
    runs = []
    for mu in (0.0, 0.5):
        folder = tmp_path / str(mu)
        folder.mkdir()
        pairs[1]["mu"] = mu
        made = scene(folder, ball("ball", mass=2.0), objects, **third | {"initial": place, "contacts": {"rules": pairs}})
        runs.append(ffsm_mj.run(made))
    assert runs[0].impacts == runs[1].impacts
    keys = [runs[1].keys.index(key) for key in runs[0].keys]
    assert np.array_equal(runs[0].log.rows, runs[1].log.rows[:, keys], equal_nan=True)
    assert not runs[1]["balance.friction_heat_J"].any()


def test_a_ball_between_two_walls(tmp_path):
    """Each impact takes 2/7 of its slip, as for a sphere that sticks; the spin is then opposite for the other wall."""
    slab = (
        '<mujoco><option gravity="0 0 0"/><worldbody><body name="wall"><geom name="wall" type="box" size="0.1 9 9"/></body>'
    )
    slab += "</worldbody></mujoco>"
    walls = [{"between": ["ball", f"{name}/wall"], "restitution": 0.9, "mu": 0.6} for name in ("left", "right")]
    path = scene(
        tmp_path,
        ball("ball", mass=2.0),
        {"left": slab, "right": slab},
        fixed={"left": {"position_m": [-0.5, 0, 0]}, "right": {"position_m": [0.5, 0, 0]}},
        duration_s=2.0,
        initial={"joints": {}, "rates": {"robot/free": [1.0, 0.5, 0, 0, 0, 0]}},
        contacts={"rules": walls},
    )
    run = proved(ffsm_mj.run(path))
    first, second, *_ = run.impacts
    assert [hit.pair for hit in run.impacts] == ["ball-right/wall", "ball-left/wall", "ball-right/wall"]
    assert first.tangential_impulse_N_s[1] == pytest.approx(2.0 * -0.5 * 2 / 7 * -1, abs=1e-12)  # on the wall
    assert first.path == "slip, stick"
    slip = [hit.slip_before_m_s[1] for hit in (first, second)]
    assert slip == pytest.approx([-0.5, -2 * 0.5 * 5 / 7], abs=1e-12)
    assert run["balance.friction_heat_J"][-1] == pytest.approx(-sum(hit.friction_work_J for hit in run.impacts), abs=1e-14)


PUSH = {"kind": "pd", "joints": ["robot/x"], "kp": 5.0, "kd": 0.0, "target": [3.0]}


def pressed(folder, phases=None, mu=0.3, sideways=0.2, **scenario):
    """A ball on slides meets a free one, e = 0, and is pushed on."""
    pair = {"between": ["ball", "target/target"], "restitution": 0.0, "mu": mu}
    return scene(
        folder,
        ball("ball", mass=2.0, joints="xyz"),
        {"target": ball("target", mass=3.0)},
        initial={"joints": {"target/free": [0.5, 0, 0, 1, 0, 0, 0]}, "rates": {"robot/x": 1.0, "robot/y": sideways}},
        phases=[{"name": "push", "until": "end", "controller": PUSH}] if phases is None else phases,
        contacts={"rules": [pair]},
        duration_s=0.5,
        **scenario,
    )


@pytest.mark.long
@pytest.mark.parametrize(("mu", "slides"), [(0.5, False), (0.01, True)])
def test_a_pressed_pair_sticks_or_slides(tmp_path, mu, slides):
    """The impact stops the slip if friction is large enough; both spheres then roll on each other, or rub."""
    run = proved(ffsm_mj.run(pressed(tmp_path, mu=mu)))
    (hit,) = run.impacts
    assert (math.hypot(*hit.slip_after_m_s) > 0.1) == slides
    row = int(run["contact.ball_target_target_force_N"].argmax())  # the pusher's target is behind: they part later
    force, normal = (
        np.array([run[f"contact.ball_target_target_force_{axis}_N"][row] for axis in "xyz"]),
        np.array([run[f"state.q_target_free_{axis}_m"][row] - run[f"state.q_robot_{axis}_m"][row] for axis in "xyz"]),
    )
    along = force @ normal / np.linalg.norm(normal)
    across = math.sqrt(force @ force - along**2)
    assert along > 0.0
    # Across the normal a difference of squares of some N is known to sqrt(1e-15).
    assert across == pytest.approx(mu * along, rel=1e-6) if slides else across < mu * along


def test_a_closed_pair_without_force_continues(tmp_path):
    run = proved(ffsm_mj.run(pressed(tmp_path, phases=[{"name": "off", "until": "end", "controller": {"kind": "off"}}])))
    assert len(run.impacts) == 1


def test_a_capture_at_the_same_instant_comes_first(tmp_path):
    """A ball touches, e = 0, and is pushed on; a grasp makes both one rigid body before friction would have to persist."""
    grasp = {"robot_site": "robot/centre", "object_site": "target/centre", "when": {"touch": ["ball-target/target"]}}
    phases = [
        {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": PUSH},
        {"name": "hold", "until": "end", "controller": PUSH},
    ]
    run = proved(ffsm_mj.run(pressed(tmp_path, phases, grasps={"grasp": grasp})))
    (hit,), (caught,) = run.impacts, run.records["grasp_impulses"]
    assert hit.time_s == caught.time_s
    missed = ffsm_mj.run(pressed(tmp_path, phases[1:], grasps={"grasp": grasp}))
    assert missed.outcome == "completed"
    assert missed.contacts


def test_a_grasp_closes_on_a_contact_pressed_by_spin(tmp_path):
    """A contact with friction that would persist is grasped at that instant; a log without the capture fails the replay."""
    path = grasps.grasping(
        tmp_path,
        contacts={"rules": [{"between": ["hand", "target/target"], "restitution": 0.0, "mu": 0.01}]},
        duration_s=0.12,
        initial={
            "joints": {"robot/free": [0.1, 0.2, 0.3, 0.96, 0.28, 0, 0], "target/free": [1.18, 0.23, 0.32, 0, 0, 0.28, 0.96]},
            "rates": {"target/free": [-0.3, 0, 0, 0.4, 2.0, 2.5], "shoulder": 0.1},
        },
    )
    run = proved(ffsm_mj.run(path))
    (hit,), (caught,), (begin,), (end,) = (
        run.impacts,
        run.grasps,
        *(run.records[kind] for kind in ("contact_beginnings", "contact_endings")),
    )
    assert hit.time_s == caught.time_s == begin.time_s == end.time_s
    assert begin.force_after_N > 0.0
    assert run.contacts == ()  # it lasted for no time; the replay needs its records
    without = with_records(run.log, {"grasp_impulses": (), "contact_endings": ()})
    again = replay_log(without)
    assert not again.agrees


RUBBING = [
    {"between": ["hand", "target/target"], "restitution": 0.5},
    {"between": ["target/target", "stone/stone"], "restitution": 0.7, "mu": 0.5},
]
THROWN = {
    "joints": {"target/free": [1.3, 0.03, 0.02, 1, 0, 0, 0], "stone/free": [2.2, 0.1, 0.05, 1, 0, 0, 0]},
    "rates": {"target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3], "stone/free": [-1.0, 0.1, 0, 3, 2, 5], "shoulder": 0.1},
}


def test_a_grasped_object_is_hit(tmp_path):
    """The stone meets link and object as one body: momenta of all subsystems, and the path, with that mass."""
    path = grasps.grasping(
        tmp_path,
        others={"stone": grasps.stone()},
        contacts={"rules": RUBBING},
        initial=THROWN,
    )
    run = proved(ffsm_mj.run(path))
    (hit,) = (hit for hit in run.impacts if hit.mu)
    assert run.grasps[0].time_s < hit.time_s < run.grasps[0].release_s
    assert hit.law == "stronge"


@pytest.mark.usefixtures("example_contact_models")
def test_an_unknown_contact_model_holds_the_hit_object(tmp_path):
    """Its model is unknown to the law: energies and works are checked nevertheless, and a false one fails."""
    path = contact_model_scenes.capture(
        tmp_path,
        {"wall": slab("wall", "0.1 2 2")},
        fixed={"wall": {"position_m": [1.5, 0, 0]}},
        duration_s=1.0,
        contacts={"rules": [{"between": ["target/target", "wall/wall"], "restitution": 0.5, "mu": 0.3}]},
        initial={
            "joints": {"target/free": [0.9, 0.03, 0.02, 1, 0, 0, 0]},
            "rates": {"robot/free": [0.8, 0, 0, 0.02, -0.03, 0.05], "target/free": [0.1, 0, 0, 0.4, -0.2, 0.3]},
        },
    )
    run = proved(ffsm_mj.run(path))
    assert run.impacts[0].time_s > run.records["welds"][0].time_s
    assert not impact_energy_check(run, friction_work_J=changed(run.impacts[0].friction_work_J)).passes


IN_TOUCH = {
    "joints": {"target/free": [1.1, 0, 0, 1, 0, 0, 0], "stone/free": [1.3, 0, 0, 1, 0, 0, 0]},
    "rates": {"robot/free": [0.5, 0, 0, 0, 0, 0], "stone/free": [0, 0.1, 0, 0, 0, 3]},
}
MEET = {"name": "meet", "until": "grasp", "arm": ["grasp"], "controller": {"kind": "off"}}
HOLD = {"name": "hold", "until": "impact", "controller": {"kind": "off"}}
LEAVE = {"name": "leave", "until": "end", "release": ["grasp"], "controller": {"kind": "off"}}


def test_an_impact_at_the_instant_of_a_release_acts_on_the_grasped_object(tmp_path):
    path = grasps.grasping(
        tmp_path,
        others={"stone": grasps.stone()},
        contacts={"rules": RUBBING},
        duration_s=1.1,
        initial=THROWN,
        phases=[MEET, HOLD, LEAVE],
    )
    run = proved(ffsm_mj.run(path))
    assert run.grasps[0].release_s == run.impacts[1].time_s
    (caught,) = run.records["grasp_impulses"]
    wrong = with_records(run.log, {"grasp_impulses": (replace(caught, robot_site="robot/no"),)})
    assert not replay_log(wrong).agrees
    assert all_checks(Run(wrong))  # a failed check, no exception


def test_a_grasp_that_closes_in_contact_causes_an_impact(tmp_path):
    """The capture comes first; the impact at that same instant acts on link and object."""
    path = grasps.grasping(
        tmp_path,
        others={"stone": grasps.stone()},
        contacts={"rules": RUBBING},
        duration_s=0.1,
        initial=IN_TOUCH,
        when={"within": {"position_m": 1.0}},
        phases=[MEET, {**HOLD, "until": "end"}],
    )
    run = proved(ffsm_mj.run(path))
    assert run.grasps[0].time_s == run.impacts[0].time_s == 0.0


def refused(path, *overrides):
    with pytest.raises(InputError) as error:
        prepare(path, overrides)
    return error.value.lines


@pytest.mark.parametrize("mu", [-0.1, -1e-300, "0.3x", True, [0.3], {"static": 0.3}, math.inf, math.nan])
def test_hostile_numbers(tmp_path, mu):
    """One line with the position and what is allowed; MuJoCo's three coefficients are not allowed."""
    path = off_centre(tmp_path)
    text = json.loads(path.read_text())
    text["contacts"]["rules"][0]["mu"] = mu
    path.write_text(json.dumps(text).replace("NaN", ".nan").replace("Infinity", ".inf"))
    (line,) = refused(path)
    assert line.startswith(f"{path}:1:")
    assert ": contacts.rules.0.mu: should be" in line


def test_laws_that_would_gain_energy_are_refused_at_load(tmp_path):
    path = off_centre(tmp_path, impact={"law": "newton"})
    (line,) = refused(path)
    assert line.startswith(f"{path}:1:")
    assert "contacts.rules.0.mu: 'impact.law: newton' does not cover friction; let mu be 0, or the law" in line
    assert prepare(path, ["contacts.rules.0.mu=0"])
    (line,) = refused(off_centre(tmp_path, e=1.2), "contacts.rules.0.super_elastic=true")
    assert "restitution above 1" in line
    assert "set mu to 0" in line


def test_an_impact_without_solution_ends_the_run(tmp_path, monkeypatch):
    resolve = contact_model.resolve
    unsolved = lambda *args: replace(resolve(*args), status="unconverged")  # noqa: E731
    monkeypatch.setattr(contact_model, "resolve", unsolved)
    run = ffsm_mj.run(flat(tmp_path))
    assert run.outcome == "unsupported_contact"
    assert "no solution for an impact of 4 contacts with friction at t = 0.3 s, residual" in run.message
    assert "robot/slab - box/box" in run.message
    assert not run.impacts


def test_spin_transfer():
    """The shipped scenario: the object touched without friction keeps its spin, the others are braked."""
    run = proved(ffsm_mj.run("spin-transfer", {"duration_s": 1.5}))
    assert [(hit.mu, hit.path) for hit in run.impacts] == [(0.0, ""), (0.2, "slip"), (0.8, "slip, stick")]
    spins = [run[f"state.v_{name}_free_wz_rad_s"][-1] for name in ("smooth", "rough", "rougher")]
    np.testing.assert_allclose(spins, (2.0, 1.8019, 1.4516), atol=5e-5)  # as docs/friction.md prints it
    impulses = [(hit.impulse_N_s, math.hypot(*hit.tangential_impulse_N_s)) for hit in run.impacts]
    np.testing.assert_allclose(impulses, ((4.1389, 0), (3.7630, 0.7526), (2.9739, 2.0839)), atol=5e-5)


@pytest.mark.parametrize(("slip", "agrees"), [(1e-10 + 2e-13, True), (1e-6, False)])
def test_a_log_replay_takes_the_logged_path_where_rounding_decides_it(tmp_path, slip, agrees):
    """A sphere sticks from the start below a slip of 1e-10 of its speed; the velocities of a log are known to 1e-12 m/s."""
    log = proved(ffsm_mj.run(on_wall(tmp_path, slip))).log
    (hit,) = log.impacts
    assert hit.path == "slip, stick"
    (still,) = ffsm_mj.run(on_wall(tmp_path, 0.0)).impacts
    changed = with_records(log, {"impacts": (replace(hit, path=still.path),)})
    assert replay_log(changed).agrees == agrees


@pytest.mark.parametrize(("field", "value"), [("path", "slip"), ("impulse_N_s", 3.8 * (1.0 + 1e-8))])
def test_a_logged_impact_that_no_rounding_makes_is_found(tmp_path, field, value):
    log = proved(ffsm_mj.run(on_wall(tmp_path, 0.5))).log
    (hit,) = log.impacts
    assert hit.impulse_N_s == pytest.approx(3.8, rel=1e-12)
    changed = with_records(log, {"impacts": (replace(hit, **{field: value}),)})
    assert not replay_log(changed).agrees


def on_wall(folder, slip):
    """A sphere of 2 kg at 1 m/s on its way to a wall, which it leaves at 0.9 m/s."""
    folder = folder / str(slip)
    folder.mkdir()
    return scene(
        folder,
        ball("ball", mass=2.0),
        {"right": slab("wall", "0.1 9 9")},
        fixed={"right": {"position_m": [0.5, 0, 0]}},
        duration_s=0.5,
        initial={"joints": {}, "rates": {"robot/free": [1.0, slip, 0, 0, 0, 0]}},
        contacts={"rules": [{"between": ["ball", "right/wall"], "restitution": 0.9, "mu": 0.6}]},
    )


def oblique(folder, e=1.0, mu=1.0, **scenario):
    """A ball on one slide, two across for one towards, meets a fixed wall at 0.67 s: its motions there are coupled."""
    pair = {"between": ["ball", "wall/wall"], "restitution": e, "mu": mu}
    return scene(
        folder,
        ball("ball", mass=2.0, joints="x").replace('axis="1 0 0"', 'axis="1 2 0"'),
        {"wall": slab("wall", "0.1 2 2")},
        fixed={"wall": {"position_m": [0.5, 0, 0]}},
        **{"initial": {"rates": {"robot/x": 1.0}}, "contacts": {"rules": [pair]}, "duration_s": 0.72} | scenario,
    )


@pytest.mark.parametrize("e", [0.5, 1.0])
def test_a_ball_that_locks_itself_is_wedged(tmp_path, capsys, e):
    """On one slide u_t = 2 u_n: both end together, friction of |f| = 1/2 < mu keeps it closed, and all energy is lost.

    The wall is 0.3 m away, 0.3 sqrt(5) m along the slide; impulses along it are m v: (n + 2 t) / sqrt(5) = 2 N s, t = mu n.
    """
    run = proved(ffsm_mj.run(oblique(tmp_path, e=e), out=tmp_path / "run", rerun=False))
    (hit,) = run.impacts
    assert (hit.status, hit.law) == ("wedged", "stronge")
    assert hit.time_s == pytest.approx(0.3 * math.sqrt(5.0), abs=1e-12)
    assert hit.impulse_N_s == pytest.approx(2.0 * math.sqrt(5.0) / 3.0, rel=1e-12)
    assert math.hypot(*hit.tangential_impulse_N_s) == pytest.approx(hit.impulse_N_s, rel=1e-12)
    assert hit.separation_speed_m_s == pytest.approx(0.0, abs=1e-12)
    assert run["state.v_robot_x_m_s"][-1] == pytest.approx(0.0, abs=1e-12)
    assert run["energy.total_J"][-1] == pytest.approx(0.0, abs=1e-14)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["impacts"][0]["status"] == "wedged"
    assert "wedged" in IMPACT.sentence(hit)
    assert main(["analyze", str(tmp_path / "run")]) == 0
    assert "wedged" in capsys.readouterr().out
    assert not impact_energy_check(run, status="ok").passes


def test_a_wedged_contact_under_load_stays_at_rest(tmp_path):
    """The slide meets the wall inside the friction cone: friction holds it against any push along the slide."""
    push = [{"name": "push", "until": "end", "controller": PUSH}]
    run = proved(ffsm_mj.run(oblique(tmp_path, phases=push, duration_s=0.36)))  # it meets the wall at 0.32 s
    assert [hit.status for hit in run.impacts] == ["wedged"]
    assert abs(run["state.v_robot_x_m_s"][-1]) < 1e-12
