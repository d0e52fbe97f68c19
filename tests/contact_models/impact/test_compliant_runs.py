"""Tangential compliance in scenarios and on MuJoCo models: elastic constants, records, replay, derivatives, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError, UnsupportedContactError
from ffsm_mj.impact import Contact, compare_laws, resolve
from ffsm_mj.scenario.contacts import ElasticConfig
from tests.contact_models.impact.test_fixed import slab
from tests.contact_models.impact.test_friction_resolve import ROD, SPHERE, UP, moving
from tests.contact_models.impact.test_friction_runs import flat, off_centre
from tests.contact_models.impact.test_linearize import linearized
from tests.replays import proved
from tests.scenes import ball, scene

LAW = {"law": "compliant"}
ELASTIC = {"elastic": {"poisson_ratio": 0.3}}


def compliant_rule(**elastic):
    pair = {"between": ["ball", "box/box"], "restitution": 0.5, "mu": 0.3, "elastic": {"poisson_ratio": 0.3} | elastic}
    return {"contacts": {"rules": [pair]}, "impact": LAW}


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """A spinning ball on a tumbling box, from its log on disk."""
    folder = tmp_path_factory.mktemp("one")
    ffsm_mj.run(off_centre(folder, **compliant_rule()), out=folder / "run", rerun=False)
    return ffsm_mj.load_run(folder / "run")


@pytest.mark.parametrize(("nu", "ratio"), [(0.0, 1.0), (0.3, 1.4 / 1.7), (0.5, 2 / 3)])
def test_one_material(nu, ratio):
    """Mindlin's 2 (1 - nu) / (2 - nu), whatever the modulus."""
    assert 1.0 / ElasticConfig(poisson_ratio=nu).compliance_ratio == pytest.approx(ratio, rel=1e-14)
    both = ElasticConfig(poisson_ratio=(nu, nu), young_modulus_Pa=(7e10, 2e11))
    assert 1.0 / both.compliance_ratio == pytest.approx(ratio, rel=1e-14)


def test_two_materials():
    """The compliances of both sides add up: a rigid side leaves the other; 4 G* / E* for aluminium on steel by hand."""
    hard = ElasticConfig(poisson_ratio=(0.1, 0.3), young_modulus_Pa=(1e30, 7e10))
    assert hard.compliance_ratio == pytest.approx(1.7 / 1.4, rel=1e-12)
    mixed = ElasticConfig(poisson_ratio=(0.33, 0.28), young_modulus_Pa=(70.0, 210.0))
    across = (2 - 0.33) / (70 / 2.66) + (2 - 0.28) / (210 / 2.56)
    along = (1 - 0.33**2) / 70 + (1 - 0.28**2) / 210
    assert 1.0 / mixed.compliance_ratio == pytest.approx(4.0 * along / across, rel=1e-14)


def test_a_run_and_its_replay(one):
    """All checks from the log, among them the impact solved again; the record names the law and the ratio."""
    run = proved(one)
    (hit,) = run.impacts[:1]
    assert hit.law == "compliant"
    assert hit.compliance_ratio == pytest.approx(1.7 / 1.4)
    assert hit.normal_work_J == pytest.approx(0.75 * hit.compression_work_J, rel=1e-9)


def test_another_law_gives_another_impact(one, tmp_path):
    rigid = ffsm_mj.run(off_centre(tmp_path), out=tmp_path / "run", rerun=False)
    assert abs(rigid.impacts[0].impulse_N_s - one.impacts[0].impulse_N_s) > 1e-6


def test_an_articulated_body():
    """A rod on slides and a hinge that strikes at 45 degrees: the law works on J M^-1 J^T, and gains no energy."""
    model, data = moving(ROD, (1.0, 0.0, -1.0, 0.3))
    contact = Contact(0, 1, np.array((0.3, 0.2, -0.1)), UP, 0.8, 0.4, 1.2)
    found = compare_laws(model, data, [contact])
    impact = found["compliant"]
    assert (impact.law, found["blend"].law) == ("compliant", "stronge")
    assert impact.energy_change_J < 0.0
    assert impact.friction.normal_work[0] + impact.friction.friction_work[0] == pytest.approx(
        impact.energy_change_J, abs=1e-13
    )


def test_a_sphere_in_any_direction():
    """Normal and slip turned in space: the same speeds after to rounding, and no spin about the normal."""
    expected = None
    for normal, across in ((UP, (1.0, 0, 0)), (np.array((2.0, -1, 2)) / 3, np.array((1.0, 2, 0)) / np.sqrt(5))):
        velocity = -normal + 1.0 * np.array(across)
        model, data = moving(SPHERE, (*velocity, 0, 0, 0))
        impact = resolve(model, data, [Contact(0, 1, -normal, normal, 0.9, 0.3, 1.2)], "compliant")
        found = impact.separation_speeds[0], impact.friction.slip_after[0] @ across
        assert impact.after.qvel[3:] @ normal == pytest.approx(0.0, abs=1e-13)
        np.testing.assert_allclose(found, found if expected is None else expected, rtol=0, atol=1e-12)
        expected = found
    assert expected[1] < 0.0


def test_rolling_goes_on_rolling():
    """A sphere without slip comes down: no tangential impulse, whatever the spin, as by every law."""
    model, data = moving(SPHERE, (0.7, 0, -1, 0, 0.7, 0))
    impact = resolve(model, data, [Contact(0, 1, -UP, UP, 0.6, 0.5, 1.2)], "compliant")
    np.testing.assert_allclose(impact.after.qvel, (0.7, 0, 0.6, 0, 0.7, 0), rtol=0, atol=1e-14)


def test_without_friction_it_is_reflection():
    model, data = moving(SPHERE, (0.7, 0, -1, 0, 0.2, 0))
    contact = [Contact(0, 1, -UP, UP, 0.6, 0.0, 1.2)]
    compliant, blend = (resolve(model, data, contact, law) for law in ("compliant", "blend"))
    np.testing.assert_array_equal(compliant.after.qvel, blend.after.qvel)


@pytest.mark.parametrize("ratio", [-1.0, np.nan, np.inf])
def test_a_ratio_that_is_none_is_refused(ratio):
    model, data = moving(SPHERE, (0.7, 0, -1, 0, 0.2, 0))
    with pytest.raises(ValueError, match="compliance_ratio, k_n / k_t, must be 0 or from 1e-6 to 1e6"):
        resolve(model, data, [Contact(0, 1, -UP, UP, 0.6, 0.1, ratio)], "compliant")


def test_several_contacts_are_refused_by_name(tmp_path):
    pair = {"between": ["slab", "box/box"], "restitution": 0.5, "mu": 0.3, "elastic": {"poisson_ratio": 0.3}}
    run = ffsm_mj.run(flat(tmp_path, contacts={"rules": [pair]}, impact=LAW), out=tmp_path / "run", rerun=False)
    assert run.outcome == "unsupported_contact"
    assert "impact law 'compliant' does not cover several contacts at one instant; use 'blend'" in run.message


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        ({}, "needs the elastic constants where mu > 0"),
        ({"elastic": {"poisson_ratio": [0.2, 0.3]}}, "need 'young_modulus_Pa' of both sides"),
        ({"elastic": {"poisson_ratio": 0.6}}, "less than or equal to 0.5"),
        ({"elastic": {"poisson_ratio": 0.3, "young_modulus_Pa": [1.0]}}, "young_modulus_Pa"),
    ],
)
def test_elastic_constants_that_do_not_serve(pair, message, tmp_path):
    rule = {"between": ["ball", "box/box"], "restitution": 0.5, "mu": 0.3} | pair
    with pytest.raises(InputError, match=message):
        prepare(off_centre(tmp_path, contacts={"rules": [rule]}, impact=LAW))


def test_default_elastic_constants(tmp_path):
    """Without rules the default has them, and is asked for them."""
    default = {"restitution": 0.5, "mu": 0.3}
    with pytest.raises(InputError, match="needs the elastic constants"):
        prepare(off_centre(tmp_path, contacts={"default": default}, impact=LAW))
    stated = {"default": default | {"elastic": {"poisson_ratio": 0.5}}}
    (pair,) = prepare(off_centre(tmp_path, contacts=stated, impact=LAW)).assemble().pairs
    assert pair.compliance_ratio == pytest.approx(1.5)


def test_derivatives(one, tmp_path):
    """The saltation matrix predicts the impact of a displaced state to second order, and is that of the law."""
    prepared = prepare(off_centre(tmp_path, **compliant_rule()))
    hit = one.impacts[0]
    qvel = np.concatenate([hit.qvel_before[joint] for joint in prepared.system.joints])
    found = linearized(prepared, hit.qpos, qvel, restitution=0.5, law="compliant")
    assert found.impact.law == "compliant"
    np.testing.assert_allclose(found.S @ found.f_before, found.f_after, atol=1e-6)
    rigid = linearized(prepared, hit.qpos, qvel, restitution=0.5, law="blend")
    assert np.abs(found.reset - rigid.reset).max() > 1e-3


def test_contact_modes_that_change_have_no_derivative(tmp_path):
    """Straight on: with slip to either side the slider slips at the end, without slip it never does."""
    prepared = prepare(off_centre(tmp_path, **compliant_rule()))
    qpos, qvel = (-0.3, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0), (1.0, *np.zeros(11))
    with pytest.raises(UnsupportedContactError, match="the contact modes change here"):
        linearized(prepared, qpos, qvel, law="compliant")


def test_sensitivity(tmp_path):
    """To the velocity of the ball: exact, by the saltation matrix of this law, and by runs, to the square of the step."""
    still = {"joints": {"box/free": [0.6, 0.1, 0.05, 1, 0, 0, 0]}, "rates": {"robot/free": [1, 0.2, 0.1, 0, 0, 0]}}
    run = ffsm_mj.run(off_centre(tmp_path, initial=still, **compliant_rule()), out=tmp_path / "run", rerun=False)
    quantity, speed = "impacts.0.impulse_N_s", {"initial.rates.robot/free.1": 1e-4}
    secant, exact = (ffsm_mj.sensitivity(run, quantity, speed, kind) for kind in ("secant", "exact"))
    found, expected = (float(one.derivative[0, 0]) for one in (exact, secant))
    assert found == pytest.approx(expected, rel=1e-5)
    ratio = ffsm_mj.sensitivity(run, quantity, {"contacts.rules.ball-box/box.elastic.poisson_ratio": 0.01})
    assert abs(float(ratio.derivative[0, 0])) > 1e-4


def test_a_ball_that_bounces_until_it_stays(tmp_path):
    """Spinning, on a floor in a uniform field: impacts in turn, the last with e = 0, then persistent contact."""
    run = ffsm_mj.run(
        scene(
            tmp_path,
            ball("ball", mass=2.0),
            {"floor": slab("floor")},
            fixed={"floor": {"position_m": [0, 0, -0.5]}},
            initial={"joints": {"robot/free": [0, 0, 0.3, 1, 0, 0, 0]}, "rates": {"robot/free": [0.4, 0.2, 0, 2, -3, 1]}},
            contacts={"rules": [{"between": ["ball", "floor/floor"], "restitution": 0.3, "mu": 0.4, **ELASTIC}]},
            impact={**LAW, "rest_interval_s": 0.02},
            environment={"fields": [{"kind": "uniform", "acceleration_m_s2": [0, 0, -5.0]}]},
            duration_s=0.6,
        ),
        out=tmp_path / "run",
        rerun=False,
    )
    proved(run)
    assert len(run.impacts) >= 3
    assert {hit.law for hit in run.impacts} == {"compliant"}
    assert run.impacts[-1].restitution_used == 0.0
    assert any("reverse slip" in hit.path for hit in run.impacts)
