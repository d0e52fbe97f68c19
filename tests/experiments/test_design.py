"""From a campaign file to every run's overrides: what is set, how, and that the run reads it."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from scipy import stats

from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.bindings import refuse_wrong_rows
from ffsm_mj.experiments.design import Design, rotated
from ffsm_mj.experiments.planning import load_campaign
from ffsm_mj.model.properties import property_value
from ffsm_mj.scenario.loading import load_scenario
from tests.experiments.files import TUMBLING, campaign_file, two_rocks
from tests.scenes import two_balls


def design(folder, dispersions, samples=None, **more):
    two_rocks(folder)
    return load_campaign(campaign_file(folder, dispersions, samples, **more)).design()


def test_absolute_scale_and_offset(tmp_path):
    made = design(
        tmp_path,
        {
            "time_step_s": {"values": [0.001]},
            "contacts.rules.0.restitution": {"scale": {"uniform": [0.5, 1.0]}},
            "initial.joints.rock/free.1": {"offset": {"normal": {"sd": 0.1}}},
        },
    )
    assert made.parameters == ("time_step_s", "contacts.rules.0.restitution.scale", "initial.joints.rock/free.1.offset")
    for run, (step, factor, offset) in enumerate(made.rows):
        assert made.overrides(run) == {
            "time_step_s": step,
            "contacts.rules.0.restitution": 0.8 * factor,
            "initial.joints.rock/free": [9.0, 8.0 + offset, *TUMBLING[2:]],
        }


def test_one_draw_for_several_keys(tmp_path):
    made = design(
        tmp_path,
        {
            "contacts.rules.*.restitution": {"uniform": [0.1, 0.9]},
            "away": {"keys": ["initial.joints.rock/free.0", "initial.joints.stone/free.0"], "offset": {"uniform": [0, 1]}},
        },
    )
    assert made.parameters == ("contacts.rules.*.restitution", "away.offset")
    for run, (restitution, away) in enumerate(made.rows):
        told = made.overrides(run)
        assert told["contacts.rules.0.restitution"] == told["contacts.rules.1.restitution"] == restitution
        assert told["initial.joints.rock/free"][0] == 9.0 + away
        assert told["initial.joints.stone/free"][0] == 5.0 + away


def test_unstated_keys_start_from_what_the_run_would_have(tmp_path):
    """Rates of the model's rest, joints of its zero, the schema's defaults."""
    made = design(
        tmp_path,
        {
            "initial.joints.robot/free.2": {"offset": {"values": [0.5]}},
            "initial.rates.stone/free.angular": {
                "offset": {"vector": {"direction": [0, 0, 2], "magnitude": {"values": [3.0]}}}
            },
            "contacts.rules.second.restitution": {"scale": {"values": [0.5]}},
            "impact.rest_speed_m_s": {"offset": {"values": [0.25]}},
        },
    )
    assert made.overrides(0) == {
        "initial.joints.robot/free": [0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0],
        "initial.rates.stone/free": [0.0, 0.0, 0.0, 0.0, 0.0, 3.0],
        "contacts.rules.1.restitution": 0.5,
        "impact.rest_speed_m_s": 0.25,
    }


def test_a_joint_is_set_under_the_name_that_the_scenario_has(tmp_path):
    """Set under another of its names beside, it would be open which of the two holds."""
    two_balls(tmp_path, initial={"joints": {"target/x": 0.5}, "rates": {"robot/x": 1.0}})
    spread = {"offset": {"values": [0.25]}}
    path = campaign_file(
        tmp_path,
        {"initial.rates.robot/x": spread},
        overrides={"objects": {}, "contacts": {"rules": []}, "initial.joints": {}},
    )
    assert load_campaign(path).design().overrides(0) == {"initial.rates.robot/x": 1.25}
    path = campaign_file(
        tmp_path, {"initial.rates.x": spread}, overrides={"objects": {}, "contacts": {"rules": []}, "initial.joints": {}}
    )
    assert load_campaign(path).design().overrides(0) == {"initial.rates.robot/x": 1.25}


@pytest.mark.parametrize("axis", ["random", [0.0, 3.0, 4.0]])
def test_a_rotation_is_by_the_stated_angle_from_where_the_body_is(tmp_path, axis):
    angle = {"truncated": {"sd": 0.2, "low": 0.0, "high": 0.5}}
    samples = {"kind": "sobol", "n": 512, "seed": 3}
    made = design(tmp_path, {"initial.joints.rock/free": {"rotation": {"axis": axis, "angle": angle}}}, samples)
    first = np.array(TUMBLING[3:])
    found = np.array([made.overrides(run)["initial.joints.rock/free"] for run in range(512)])
    np.testing.assert_array_equal(found[:, :3], [TUMBLING[:3]] * 512)
    np.testing.assert_allclose(np.linalg.norm(found[:, 3:], axis=1), 1.0, rtol=1e-15 * 8)
    turns = np.array([relative(quaternion, first) for quaternion in found[:, 3:]])
    angles = 2.0 * np.arctan2(np.linalg.norm(turns[:, 1:], axis=1), turns[:, 0])
    np.testing.assert_allclose(angles, [row[0] for row in made.rows], atol=1e-12)
    assert stats.kstest(angles, stats.truncnorm(0.0, 2.5, scale=0.2).cdf).pvalue > 0.05
    axes = turns[:, 1:] / np.linalg.norm(turns[:, 1:], axis=1)[:, None]
    if axis == "random":  # a coordinate of a uniform direction is uniform
        for coordinate in axes.T:
            assert stats.kstest(coordinate, stats.uniform(-1.0, 2.0).cdf).pvalue > 0.05
    else:
        np.testing.assert_allclose(axes, [[0.0, 0.6, 0.8]] * 512, atol=1e-12)


def relative(quaternion, first):
    """The turn in world axes that leads from the first quaternion to the other."""
    (w, *v), (w0, *v0) = quaternion, first
    v, v0 = np.array(v), -np.array(v0)
    return np.array([w * w0 - v @ v0, *(w * v0 + w0 * v + np.cross(v, v0))])


def test_a_quarter_turn_about_z_takes_x_to_y():
    """Cos 45 degrees and sin 45 degrees; a second one about the world's x then takes y to z."""
    once = rotated([1.0, 0.0, 0.0, 0.0], (0.0, 0.0, 1.0), math.pi / 2)
    np.testing.assert_allclose(once, [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)], atol=1e-15)
    np.testing.assert_allclose(rotated(once, (1.0, 0.0, 0.0), math.pi / 2), [0.5, 0.5, -0.5, 0.5], atol=1e-15)


def test_a_vector_is_a_direction_times_a_magnitude(tmp_path):
    vector = {"vector": {"direction": "random", "magnitude": {"uniform": [1.0, 2.0]}}}
    made = design(tmp_path, {"initial.rates.rock/free.linear": vector}, {"kind": "sobol", "n": 256, "seed": 5})
    found = np.array([made.overrides(run)["initial.rates.rock/free"] for run in range(256)])
    np.testing.assert_array_equal(found[:, 3:], [[0.0, 0.0, 0.2]] * 256)
    lengths = np.linalg.norm(found[:, :3], axis=1)
    np.testing.assert_allclose(lengths, [row[0] for row in made.rows], rtol=1e-14)
    for coordinate in (found[:, :3] / lengths[:, None]).T:
        assert stats.kstest(coordinate, stats.uniform(-1.0, 2.0).cdf).pvalue > 0.05
    assert [name.removeprefix("initial.rates.rock/free.linear.") for name in made.parameters] == [
        "magnitude",
        "direction_z",
        "direction_azimuth_rad",
    ]


def test_a_grid_is_every_combination(tmp_path):
    made = design(
        tmp_path,
        {
            "contacts.rules.0.restitution": {"values": [0.9, 0.1]},
            "impact.law": {"choice": ["newton", "poisson"]},
            "initial.joints.rock/free.0": {"offset": {"grid": {"low": 0.0, "high": 1.0, "levels": 3}}},
        },
        {"kind": "grid"},
    )
    assert made.n == len(made.rows) == 12
    assert set(made.rows) == {(e, law, x) for e in (0.1, 0.9) for law in ("newton", "poisson") for x in (0.0, 0.5, 1.0)}
    assert made.overrides(0) == {
        "contacts.rules.0.restitution": 0.1,
        "impact.law": "newton",
        "initial.joints.rock/free": TUMBLING,
    }


def test_saltelli_has_n_rows_for_each_parameter_and_two_more(tmp_path):
    spread = {"offset": {"uniform": [0.0, 1.0]}}
    made = design(
        tmp_path,
        {"initial.joints.rock/free.0": spread, "initial.joints.rock/free.1": spread},
        {"kind": "saltelli", "n": 4, "seed": 1},
    )
    assert (made.n, len(made.rows)) == (4, 16)


@pytest.mark.parametrize("kind", ["random", "lhs", "sobol", "saltelli"])
def test_a_design_comes_back_from_its_file_bit_by_bit(tmp_path, kind):
    made = design(
        tmp_path,
        {
            "initial.joints.rock/free": {"rotation": {"axis": "random", "angle": {"normal": {"sd": 0.3}}}},
            "impact.law": {"choice": ["newton", "blend"]},
            "impact.rest_speed_m_s": {"lognormal": {"median": 1e-7, "sigma": 2.0}},
        },
        {"kind": kind, "n": 8, "seed": 2},
    )
    again = Design.from_json(made.to_json())
    assert again == made
    assert pickle.loads(pickle.dumps(made)) == made
    for run in range(len(made.rows)):
        assert again.overrides(run) == made.overrides(run)
        plain(made.overrides(run))


def plain(value):
    """Numbers of NumPy would be written into overrides as ``np.float64(5.3)``."""
    if isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            plain(item)
    else:
        assert type(value) in (float, int, bool, str)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": 2}', '{"format": 1, "kind": "random"}'])
def test_what_is_no_design(text):
    with pytest.raises(InputError):
        Design.from_json(text)


def test_an_extended_design_keeps_its_runs(tmp_path):
    two_rocks(tmp_path)
    y = {"initial.joints.rock/free.1": {"offset": {"uniform": [0.0, 1.0]}}}
    for kind, n, longer in (("random", 8, 13), ("sobol", 8, 32)):
        plan = load_campaign(campaign_file(tmp_path, y, {"kind": kind, "n": n, "seed": 9}))
        first = plan.design()
        more = plan.extended(first, longer)
        assert (more.n, len(more.rows)) == (longer, longer)
        assert more.rows[:n] == first.rows
        assert [more.overrides(run) for run in range(n)] == [first.overrides(run) for run in range(n)]


@pytest.mark.parametrize(
    ("kind", "n", "message"),
    [
        ("lhs", 16, "a design of kind lhs cannot be extended: a larger one has other samples; allowed: random, sobol"),
        ("saltelli", 16, "a design of kind saltelli cannot be extended"),
        ("sobol", 12, "cannot be extended to 12: a power of 2 above the present 8 is required"),
        ("random", 8, "cannot be extended to 8: a number above the present 8 is required"),
    ],
)
def test_what_cannot_be_extended(tmp_path, kind, n, message):
    two_rocks(tmp_path)
    y = {"initial.joints.rock/free.1": {"offset": {"uniform": [0.0, 1.0]}}}
    plan = load_campaign(campaign_file(tmp_path, y, {"kind": kind, "n": 8, "seed": 9}))
    with pytest.raises(InputError, match=message):
        plan.extended(plan.design(), n)


def test_a_design_of_another_file_is_not_extended(tmp_path):
    two_rocks(tmp_path)
    wide, narrow = ({"initial.joints.rock/free.1": {"offset": {"uniform": [0.0, end]}}} for end in (1.0, 0.5))
    first = load_campaign(campaign_file(tmp_path, wide)).design()
    with pytest.raises(InputError, match="the extended design would not begin with the present runs"):
        load_campaign(campaign_file(tmp_path, narrow)).extended(first, 16)


def test_every_run_reads_what_was_drawn(tmp_path):
    """The whole way of a run: overrides as JSON, read and validated with the scenario's file."""
    made = design(
        tmp_path,
        {
            "initial.joints.rock/free.0": {"normal": {"mean": 9.0, "sd": 1e-6}},
            "contacts.rules.*.restitution": {"uniform": [0.0, 1.0]},
            "impact.rest_speed_m_s": {"lognormal": {"median": 1e-9, "sigma": 5.0}},
        },
    )
    for run, (x, restitution, speed) in enumerate(made.rows):
        given = [f"{key}={value!r}" for key, value in made.overrides(run).items()]
        scenario, _ = load_scenario(tmp_path / "scene.yaml", given)
        assert scenario.initial.joints["rock/free"] == (x, *TUMBLING[1:])
        assert [pair.restitution for pair in scenario.contacts.rules] == [restitution] * 2
        assert scenario.impact.rest_speed_m_s == speed


def test_a_dispersion_that_is_not_applied_is_noticed(tmp_path, monkeypatch):
    """Overrides that get lost, as they do where a key is set on a copy."""
    two_rocks(tmp_path)
    plan = load_campaign(campaign_file(tmp_path, {"contacts.rules.0.restitution": {"uniform": [0.1, 0.2]}}))
    made = plan.design()
    monkeypatch.setattr(type(plan.base.source), "overridden", lambda source, _: source)
    with pytest.raises(
        InputError, match=r"campaign\.yaml:10:\d+: dispersions.contacts.rules.0.restitution: run 0: .*not applied"
    ):
        refuse_wrong_rows(plan.base, made, plan.source, plan.scalars)


def test_properties_of_models(tmp_path):
    """An unstated one starts from the compiled model: a ball of 1 kg with 0.4 m r^2."""
    made = design(
        tmp_path,
        {
            "model.rock.rock.mass_kg": {"scale": {"values": [1.5]}},
            "model.rock.rock.centre_of_mass_m": {"vector": {"direction": [0, 0, 1], "magnitude": {"values": [0.01]}}},
            "model.stone.stone.geoms.stone.size_m.0": {"offset": {"values": [0.05]}},
            "controller_model.robot.ball.mass_kg": {"offset": {"values": [-0.25]}},
        },
    )
    told = made.overrides(0)
    assert told["model.rock.rock.mass_kg"] == 1.5
    assert told["model.rock.rock.centre_of_mass_m"] == [0.0, 0.0, 0.01]
    assert told["model.stone.stone.geoms.stone.size_m"] == pytest.approx([0.15])
    assert told["controller_model.robot.ball.mass_kg"] == 0.75
    run = prepare(tmp_path / "scene.yaml", told)
    assert property_value(run.system.mj, "model.rock.rock.mass_kg") == 1.5
    assert property_value(run.controller_system.mj, "controller_model.robot.ball.mass_kg") == 0.75


def test_wildcards_in_models(tmp_path):
    made = design(
        tmp_path,
        {
            "model.*.*.mass_kg": {"scale": {"values": [2.0]}},
            "radii": {"keys": ["model.stone.*.geoms.*.size_m.0"], "scale": {"values": [3.0]}},
        },
    )
    assert made.overrides(0) == {
        "model.robot.ball.mass_kg": 2.0,
        "model.rock.rock.mass_kg": 2.0,
        "model.stone.stone.mass_kg": 2.0,
        "model.stone.stone.geoms.stone.size_m": [pytest.approx(0.3)],
    }


def test_a_mass_that_the_model_swallows_is_noticed(tmp_path, monkeypatch):
    """Such as by ``settotalmass``, were it left in: the compiled value is read, not the one that was asked for."""
    two_rocks(tmp_path)
    plan = load_campaign(campaign_file(tmp_path, {"model.rock.rock.mass_kg": {"scale": {"uniform": [1.0, 1.001]}}}))
    monkeypatch.setattr(PreparedRun, "changed", lambda *_: plan.base)
    with pytest.raises(InputError, match=r"model.rock.rock.mass_kg is 1.0 although 1.000\d+ was sampled: .*not applied"):
        plan.design()


@pytest.mark.parametrize(
    ("dispersion", "drawn"),
    [
        ({"values": [3, 1, 2]}, [1, 2, 3]),
        ({"choice": [3, 1]}, [3, 1]),
        ({"grid": {"low": 1, "high": 5, "levels": 3}}, [1, 3, 5]),
        ({"scale": {"values": [2, 1]}}, [10_000, 20_000]),
        ({"offset": {"values": [5, -5]}}, [9_995, 10_005]),
    ],
)
def test_a_key_that_counts_is_dispersed_by_integers(tmp_path, dispersion, drawn):
    """The scenario takes an integer and no float, so integers of the file stay integers, through design.json too."""
    made = design(tmp_path, {"impact.max_impacts": dispersion}, {"kind": "grid"})
    for each in (made, Design.from_json(made.to_json())):
        told = [each.overrides(run)["impact.max_impacts"] for run in range(len(drawn))]
        assert told == drawn
        assert all(type(value) is int for value in told)


def test_numbers_of_both_kinds_are_one_column_of_floats(tmp_path):
    made = design(tmp_path, {"duration_s": {"values": [2, 0.5]}}, {"kind": "grid"})
    assert [(value, type(value)) for (value,) in made.rows] == [(0.5, float), (2.0, float)]
