"""Campaign files: what is wrong with one is told in a line with its place, and the words for what is right."""

from __future__ import annotations

import json

import jsonschema
import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.conditions import conditions
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.file import campaign_names, campaign_path, is_campaign
from ffsm_mj.experiments.planning import load_campaign
from ffsm_mj.scenario.shipped import scenarios_dir
from ffsm_mj.yaml import read_node
from tests.experiments.files import campaign_file, two_rocks

GOOD = {"contacts.rules.0.restitution": {"uniform": [0.1, 0.9]}}


def line_of(folder, dispersions=None, samples=None, **more):
    """The one line by which a campaign is refused, before or while it is drawn."""
    two_rocks(folder)
    path = campaign_file(folder, GOOD if dispersions is None else dispersions, samples, **more)
    with pytest.raises(InputError) as caught:
        load_campaign(path).design()
    assert len(caught.value.lines) == 1
    line = caught.value.lines[0]
    assert line.startswith(f"{path}:")
    return line.removeprefix(f"{path}:")


@pytest.mark.parametrize(
    ("dispersions", "message"),
    [
        ({}, "dispersions: should have at least 1 item"),
        (
            {"a": {}},
            "dispersions.a: needs one of uniform, normal, truncated, lognormal, choice, values, grid, vector, scale, ",
        ),
        (
            {"duration_s": {"unifrom": [1, 2]}},
            "unknown key (did you mean 'uniform'?); allowed: choice, grid, keys, lognormal",
        ),
        (
            {"duration_s": {"normal": {"sd": 1}}},
            "needs a 'mean'; only scale, offset and angle have a default",
        ),
        (
            {"duration_s": {"scale": {"normal": {"sd": 0}}}},
            "dispersions.duration_s.scale.normal.sd: should be greater than 0",
        ),
        (
            {"duration": GOOD["contacts.rules.0.restitution"]},
            "dispersions.duration: unknown key 'duration' (did you mean 'duration_s'",
        ),
        (
            {"contacts.rules.0.restition": {"values": [1]}},
            "unknown key 'restition' (did you mean 'restitution'?); allowed: between, ",
        ),
        (
            {"contacts.rules.2.restitution": {"values": [1]}},
            "contacts.rules is a list of 2: unknown position or name '2'; allowed: ",
        ),
        ({"contacts.rules.secnd.restitution": {"values": [1]}}, "'secnd' (did you mean 'second'?)"),
        ({"contacts.rules.*.nme": {"values": [1]}}, "unknown key 'nme' (did you mean 'name'?)"),
        (
            {"contacts.ignored.*.reason": {"choice": ["x"]}},
            "matches nothing in this scenario",
        ),
        (
            {"initial.joints.rok/free.0": {"values": [1]}},
            "unknown joint 'rok/free' (did you mean 'rock/free'?); allowed: robot/free",
        ),
        ({"initial.joints.rock/free.7": {"values": [1]}}, "is a list of 7: its positions are 0 to 6, position, quaternion"),
        (
            {"initial.joints.rock/free": {"values": [1]}},
            "is a list of 7: name one of its numbers (initial.joints.rock/free.0)",
        ),
        ({"initial.joints": {"values": [1]}}, "initial.joints is a mapping; name a joint"),
        (
            {"impact": {"values": [1]}},
            "impact is a mapping; name one of its keys: law, max_impacts, rest_interval_s, rest_speed_m_s",
        ),
        ({"objects.rok.fixed": {"choice": [True]}}, "unknown name 'rok' (did you mean 'rock'?); allowed: rock, stone"),
        ({"task.target_m.0": {"values": [1]}}, "the scenario has no task"),
        (
            {"impact.rest_interval_s": {"scale": {"values": [1]}}},
            "has no value, but scale needs a number: set it under overrides",
        ),
        ({"conservative": {"offset": {"values": [1]}}}, "conservative is True, not a number, but offset needs a number"),
        ({"duration_s.0": {"values": [1]}}, "duration_s is a single value and has no '0'"),
        (
            {"duration_s": {"vector": {"direction": "random", "magnitude": {"values": [1]}}}},
            "is not a vector of 3 numbers; for a free",
        ),
        (
            {"duration_s": {"rotation": {"axis": "random", "angle": {"values": [1]}}}},
            "duration_s is not an attitude; rotate a free",
        ),
        ({"duration_s": {"rotation": {"axis": [0, 0, 0], "angle": {"values": [1]}}}}, "rotation: axis must not be zero"),
        (
            {"duration_s": {"rotation": {"axis": "any", "angle": {"values": [1]}}}},
            "rotation.axis: should be 'random', got \"any\"",
        ),
        ({"model.rok.rock.mass_kg": {"values": [1]}}, "unknown body 'rok/rock' (did you mean 'rock/rock'?); allowed: "),
        ({"model.rock.rock.mas_kg": {"values": [1]}}, "unknown property 'mas_kg' (did you mean 'mass_kg'?)"),
        ({"model.rock.rock": {"values": [1]}}, "model.rock.rock is not a property; write model.TREE.BODY.PROPERTY"),
        ({"model.rock.*.mas_kg": {"values": [1]}}, "unknown property 'mas_kg' (did you mean 'mass_kg'?)"),
        ({"model.rck.*.mass_kg": {"values": [1]}}, "matches nothing in this scenario"),
        ({"model.rock.rock.mass_kg": {"scale": {"uniform": [-1, 1]}}}, "mass_kg: should be greater than 0"),
        (
            {"duration_s": {"scale": {"choice": ["a"]}}},
            "scale: needs a choice of numbers; texts and flags can only replace",
        ),
        (
            {"x": {"keys": ["initial.joints.rock/free"], "rotation": {"axis": "random", "angle": {"choice": [True]}}}},
            "angle: needs a choice",
        ),
        (
            {"duration_s": {"lognormal": {"median": 1, "sigma": 1000}}},
            "dispersions.duration_s: exceeds the range of floating-point numbers",
        ),
        (
            {"duration_s": {"uniform": [-1e308, 1e308]}},
            "dispersions.duration_s: exceeds the range of floating-point numbers",
        ),
        ({"duration_s": {"truncated": {"mean": 0, "sd": 1, "low": 1e300}}}, "duration_s"),
        (
            {"impact.law": {"choice": ["newton", {}]}},
            "dispersions.impact.law.choice.1: should be a finite number, a text, a flag or a list of numbers",
        ),
        (
            {"impact.law": {"choice": ["newton", [1]]}},
            "the values of a choice must have one type",
        ),
        ({"impact.law": {"choice": [[1], [2]]}}, "impact.law: should be 'blend', 'poisson', 'newton' or 'compliant'"),
        ({"duration_s": {"scale": {"choice": [[1]]}}}, "scale: needs a choice of numbers; texts and flags can only replace"),
        (
            {
                "initial.joints.rock/free": {"choice": [[0, 0, 0, 1, 0, 0, 0]]},
                "initial.joints.rock/free.4": {"values": [1]},
            },
            "initial.joints.rock/free.4 is already dispersed by 'initial.joints.rock/free'",
        ),
        ({"a=b": {"values": [1]}}, "a key that contains '=' cannot be set"),
        (
            {"x": {"keys": ["duration_s", "nothing"], "values": [1]}},
            "dispersions.x.keys.1: unknown key 'nothing'; allowed: ",
        ),
        (
            {"duration_s": {"grid": {"low": 0, "high": 1, "levels": 3}}},
            "has levels of a grid, but the samples are of kind random; write values",
        ),
        (
            {"duration_s": {"values": [1]}, "again": {"keys": ["duration_s"], "values": [1]}},
            "dispersions.again.keys.0: duration_s is already dispersed by 'duration_s'",
        ),
        (
            {
                "initial.joints.rock/free": {"rotation": {"axis": "random", "angle": {"values": [1]}}},
                "initial.joints.rock/free.4": {"values": [1]},
            },
            "initial.joints.rock/free.4 is already dispersed by 'initial.joints.rock/free'",
        ),
        (
            {"a": {"keys": ["duration_s"], "scale": {"values": [1]}}, "a.scale": {"keys": ["time_step_s"], "values": [1]}},
            "dispersions.a.scale: a.scale and a.scale have one column; rename one entry, with its keys under 'keys'",
        ),
        ({"contacts.rules.*.restitution": {"uniform": [0.5, 1.2]}}, "restitution must be in [0, 1]; above 1 only with"),
        (
            {"impact.max_impacts": {"uniform": [1, 9]}},
            "impact.max_impacts is an integer: disperse it with integers in values, choice",
        ),
        ({"impact.max_impacts": {"values": [1.0, 2]}}, "dispersions.impact.max_impacts: impact.max_impacts is an integer"),
        (
            {"impact.max_impacts": {"scale": {"uniform": [1, 2]}}},
            "impact.max_impacts is an integer: disperse it with integers",
        ),
        ({"impact.max_impacts": {"values": [0, 2]}}, "impact.max_impacts: should be greater than 0, got 0"),
        ({"impact.max_impacts": {"values": [True, 2]}}, "max_impacts.values.0: should be a finite number, got true"),
        (
            {"impact.law": {"choice": ["newton", "wrong"]}},
            "impact.law: should be 'blend', 'poisson', 'newton' or 'compliant', got \"wrong\"",
        ),
        ({"time_step_s": {"uniform": [0.001, 0.0011]}}, "must be a multiple of time_step_s"),
        ({"initial.rates.rock/free.0": {"uniform": [0, 1e11]}}, "run "),
    ],
)
def test_dispersions_that_cannot_be(tmp_path, dispersions, message):
    assert message in line_of(tmp_path, dispersions)


def test_a_fault_of_a_run_names_the_run_and_the_entry(tmp_path):
    """The least and the greatest value are tried, whichever run has them."""
    line = line_of(
        tmp_path,
        {"pairs": {"keys": ["contacts.rules.*.restitution"], "uniform": [0.5, 1.001]}},
        {"kind": "sobol", "n": 1024},
    )
    assert line.split(": ")[:2] == ["9:3", "dispersions.pairs"]
    assert "run " in line
    assert "contacts.rules.0: restitution must be in [0, 1]" in line


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        ({"kind": "sobol", "n": 100}, "samples: n must be a power of 2 for sobol: 64 or 128, not 100"),
        ({"kind": "saltelli", "n": 3}, "samples: n must be a power of 2 for saltelli: 2 or 4, not 3"),
        ({"kind": "random"}, "samples: needs 'n', the number of samples; only a grid has none"),
        ({"kind": "grid", "n": 4}, "a grid has one run per combination of its levels; leave n out"),
        (
            {"kind": "grid"},
            "dispersions.contacts.rules.0.restitution: has no levels for a grid; write values, choice or grid",
        ),
        (
            {"kind": "montecarlo", "n": 4},
            "samples.kind: should be 'random', 'lhs', 'sobol', 'saltelli' or 'grid', got \"montecarlo\"",
        ),
        ({"kind": "random", "n": 0}, "samples.n: should be greater than or equal to 1, got 0"),
        ({"kind": "random", "n": 4, "seed": -1}, "samples.seed: should be greater than or equal to 0, got -1"),
        ({"kind": "saltelli", "n": 2**23}, "samples: gives 25165824 runs; at most 10000000"),
    ],
)
def test_samples_that_cannot_be(tmp_path, samples, message):
    assert message in line_of(tmp_path, None, samples)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"metric": []}, "metric: unknown key (did you mean 'metrics'?); allowed: campaign, "),
        ({"scenario": "nothing.yaml"}, "scenario: {folder}/nothing.yaml: no such scenario file"),
        (
            {"scenario": "basline"},
            "scenario: basline: no such file, and unknown shipped scenario 'basline' (did you mean 'baseline'?)",
        ),
        ({"overrides": {"duration_s": -1}}, "overrides.duration_s: duration_s: should be greater than 0, got -1"),
        ({"overrides": {"dur\x00ation": 3}}, r"overrides.dur\x00ation: dur\x00ation: unknown key"),
        ({"overrides": {"phases.5.name": "x"}}, "overrides.phases.5.name: phases is a list of 1: its positions are 0 to 0"),
        ({"success": "tip.error_m"}, "success: 'tip.error_m' is not a condition; write METRIC OPERATOR NUMBER, e.g. "),
        ({"success": "duration_s < 3 or steps > 1"}, "is not a condition"),
        (
            {"success": "duration_s < three"},
            "'three' is not a number; a metric can be compared with a number, true or false",
        ),
        ({"metrics": ["steps", "steps"]}, "metrics: steps is listed twice"),
        ({"metrics": ["steps", "stps"]}, "metrics.1: unknown metric 'stps' (did you mean 'steps'?)"),
        ({"success": "stps > 3"}, "success: unknown metric 'stps' (did you mean 'steps'?)"),
        ({"keep": {"worst": {"stps": 3}}}, "keep.worst.stps: unknown metric 'stps'"),
        ({"stop": {"metric": "stps", "width": 0.1}}, "stop.metric: unknown metric 'stps'"),
        ({"stop": {"metric": "success", "width": 0.1}}, "stop.metric: the campaign has no success condition: set 'success'"),
        ({"keep": {"failures": -1}}, "keep.failures: should be greater than or equal to 0, got -1"),
        ({"limits": {"max_failed": 2.0}}, "limits.max_failed: should be less than or equal to 1, got 2.0"),
        ({"limits": {"timeout_s": 0}}, "limits.timeout_s: should be greater than 0, got 0"),
        ({"campaign": "a b"}, "campaign: must be written like"),
    ],
)
def test_other_keys_that_cannot_be(tmp_path, more, message):
    assert message.format(folder=tmp_path) in line_of(tmp_path, **more)


def test_faults_of_the_base_scenario_are_told_where_they_are(tmp_path):
    scenario = two_rocks(tmp_path, duration_s=-1)
    with pytest.raises(InputError) as caught:
        load_campaign(campaign_file(tmp_path, GOOD))
    assert str(caught.value).startswith(f"{scenario}:1:")


def test_a_file_that_is_not_there_or_no_mapping(tmp_path):
    for name, message in (("nothing.yaml", "no such campaign file"), ("nothing", "unknown shipped campaign 'nothing'")):
        with pytest.raises(InputError, match=message):
            load_campaign(name)
    (tmp_path / "list.yaml").write_text("- 1\n")
    with pytest.raises(InputError, match=r"list\.yaml:1:1: a campaign is a mapping of keys to values"):
        load_campaign(tmp_path / "list.yaml")


def test_overrides_of_the_campaign_file(tmp_path):
    two_rocks(tmp_path)
    path = campaign_file(tmp_path, GOOD)
    assert len(load_campaign(path, ["samples.n=3"]).design().rows) == 3
    with pytest.raises(InputError, match=r"^overrides: samples\.n=no: samples\.n: should be a valid integer, got \"no\""):
        load_campaign(path, ["samples.n=no"])


def test_overrides_of_the_base_are_what_dispersions_start_from(tmp_path):
    two_rocks(tmp_path)
    path = campaign_file(
        tmp_path,
        {"initial.joints.stone/free.0": {"offset": {"values": [1.0]}}},
        overrides={"initial.joints.stone/free": [3.0, 0, 0, 1, 0, 0, 0]},
    )
    plan = load_campaign(path)
    assert plan.design().overrides(0) == {"initial.joints.stone/free": [4.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]}
    assert [json.loads(text.partition("=")[2]) for text in plan.overrides] == [[3.0, 0, 0, 1, 0, 0, 0]]


def test_every_metric_that_is_asked_for_is_kept_once(tmp_path):
    two_rocks(tmp_path)
    path = campaign_file(
        tmp_path,
        GOOD,
        metrics=["steps"],
        success="impacts.count == 0 and steps > 1",
        keep={"worst": {"drift": 2}},
        stop={"metric": "duration_s", "width": 1.0},
    )
    assert load_campaign(path).config.all_metrics == ("steps", "impacts.count", "drift", "duration_s")


@pytest.mark.parametrize(
    ("text", "metrics", "holds"),
    [
        ("a < 1", {"a": 0.5}, True),
        ("a < 1", {"a": 1.0}, False),
        ("a<=1 and b.0.c>=-2e-3", {"a": 1.0, "b.0.c": 0.0}, True),
        ("a<=1 and b.0.c>=-2e-3", {"a": 1.0, "b.0.c": -1.0}, False),
        ("a < 1", {"a": None}, False),
        ("a != 1", {}, False),
        ("checks_pass == true", {"checks_pass": True}, True),
        ("checks_pass == true", {"checks_pass": False}, False),
        ("hand > 1 and sand == 2", {"hand": 3, "sand": 2}, True),
    ],
)
def test_success(text, metrics, holds):
    assert all(condition.holds(metrics) for condition in conditions(text)) == holds


@pytest.mark.long
@pytest.mark.parametrize("name", campaign_names())
def test_shipped_campaigns_are_valid(name):
    plan = load_campaign(name)
    assert plan.config.campaign == name
    assert plan.config.description
    if not plan.config.variants:
        plan.design()
    elif plan.variants.keys() != plan.config.variants.keys():
        pytest.fail(f"not applicable: {plan.not_applicable}")


@pytest.mark.long(one_of=5)
@pytest.mark.parametrize("name", campaign_names())
def test_the_committed_schema_is_current_and_takes_the_shipped_campaigns(name, capsys):
    assert main(["schema", "--campaign"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema == json.loads((scenarios_dir() / "ffsm-campaign.schema.json").read_text())
    data = read_node(campaign_path(name)).plain()
    jsonschema.validate(data, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(data | {"sample": 3}, schema)


def test_check_tells_what_would_run(tmp_path, capsys):
    """A rock that is moved onto the robot is no fault of the file: such a run is a row of the table."""
    two_rocks(tmp_path)
    onto = {"scale": {"uniform": [0.0, 1.0]}}
    dispersions = {"x": {"keys": ["initial.joints.stone/free.0"]} | onto, **GOOD}
    path = campaign_file(tmp_path, dispersions, {"kind": "sobol", "n": 256}, success="steps > 1")
    assert main(["check", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["try: valid", "  256 runs of scene (sobol, seed 0)"]
    assert lines[2].endswith(", sets initial.joints.stone/free")
    assert "  success: steps > 1" in lines
    assert "  base scene: valid" in lines
    note = next(line for line in lines if line.startswith("note: run "))
    assert "overlap by" in note
    assert main(["check", str(path), "-s", "samples.n=5"]) == 2
    assert main(["check", "baseline", "-s", "campaign=x"]) == 2


def test_a_campaign_is_told_from_a_scenario(tmp_path, capsys):
    scenario = two_rocks(tmp_path)
    campaign = campaign_file(tmp_path, GOOD)
    assert main(["run", str(campaign)]) == 2
    assert main(["campaign", "run", str(scenario), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.splitlines() == [
        f"{campaign}: is a campaign, not a scenario; use 'ffsm campaign run {campaign}'",
        f"{scenario}: is a scenario, not a campaign; use 'ffsm run {scenario}'",
    ]
    assert is_campaign(campaign_file(tmp_path, GOOD))
    assert not any(map(is_campaign, (scenario, tmp_path, "baseline", "nothing", tmp_path / "nothing.yaml")))
