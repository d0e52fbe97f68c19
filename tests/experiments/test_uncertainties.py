"""Sensitivities of runs: the interval of the sentence against further runs, exact derivatives, and what is refused."""

from __future__ import annotations

import html
import json

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.uncertainty import in_words
from ffsm_mj.report.page.document import sensitivity_html
from tests.scenes import two_balls

PLACE = "initial.joints.object/y"


@pytest.fixture(scope="module")
def coasting():
    return ffsm_mj.run("coasting", {"duration_s": 5.5})


@pytest.fixture(scope="module")
def of_place(coasting):
    return ffsm_mj.sensitivity(coasting, "impacts.0.impulse_N_s", {PLACE: 1e-3})


def test_the_sentence_of_a_run(of_place):
    assert list(of_place.sentences()) == [
        "1 mm in initial.joints.object/y changes the impulse of impact 1 by 0.0829 %: 1.221322 to 1.22335 N s"
    ]


def test_five_further_runs_are_inside_the_interval(of_place):
    """Values within one standard deviation give impulses within the interval of the sentence, in order."""
    found = [
        ffsm_mj.run("coasting", {"stop_on_impact": True, PLACE: -0.5 + share * 1e-3}).impacts[0].impulse_N_s
        for share in (-0.9, -0.4, 0.1, 0.6, 0.95)
    ]
    assert of_place.low[0, 0] < found[0]
    assert found == sorted(found)
    assert found[-1] < of_place.high[0, 0]
    # To first order they follow the slope: the curvature is 1e-3 of it over the interval.
    assert found[2] - of_place.nominal[0] == pytest.approx(of_place.derivative[0, 0] * 1e-4, rel=1e-2)


@pytest.mark.long
def test_secant_and_exact_agree_on_a_coasting_run(coasting):
    """Secants over h differ from derivatives by h^2: 1e-5 of them is far below the digits compared."""
    of = ("impacts.0.impulse_N_s", "impacts.0.time_s")
    wrt = {PLACE: 1e-5, "initial.joints.object/x": 1e-5, "initial.rates.joint_3": 1e-5}
    secant, exact = ffsm_mj.sensitivity(coasting, of, wrt), ffsm_mj.sensitivity(coasting, of, wrt, "exact")
    assert secant.derivative == pytest.approx(exact.derivative, abs=1e-5)
    # Published digits of this scenario: 1/u, and 1.0139 N s per metre.
    assert exact.derivative[0, 0] == pytest.approx(1.0139, abs=1e-4)
    assert exact.derivative[1, 1] == pytest.approx(-3.0875, abs=1e-4)


def test_restitution_at_its_bound_has_one_side(coasting):
    key = "contacts.rules.0.restitution"
    secant = ffsm_mj.sensitivity(coasting, "impacts.0.impulse_N_s", {key: 0.02})
    assert secant.sides == ("minus",)
    assert next(secant.sentences()).endswith("(the scenario allows minus alone)")
    exact = ffsm_mj.sensitivity(coasting, "impacts.0.impulse_N_s", {key: 0.02}, "exact")
    # The impulse is linear in e: I / (1 + e).
    assert secant.derivative == pytest.approx(exact.derivative, rel=1e-9)
    assert exact.derivative[0, 0] == pytest.approx(coasting.impacts[0].impulse_N_s / 2.0, rel=1e-9)


def test_closed_form_of_two_balls(tmp_path):
    """Balls of 2 and 3 kg at 1 m/s, gap 0.3 m, e = 0.5: I = (1 + e) v m, m = 6/5 kg, t = gap / v; by mass and by rate."""
    run = ffsm_mj.run(two_balls(tmp_path, restitution=0.5))
    wrt = {"initial.rates.robot/x": 1e-3, "model.target.target.mass_kg": 3e-3, "initial.joints.target/x": 2e-3}
    found = ffsm_mj.sensitivity(run, ("impacts.0.impulse_N_s", "impacts.0.time_s"), wrt)
    # dI = 1.5 m dv + 1.5 v (2 / 5)^2 dm2; dt = -0.3 dv, 1 dx; secants are right to h^2 = 1e-6.
    wanted = [[1.5 * 1.2, 1.5 * 4.0 / 25.0, 0.0], [-0.3, 0.0, 1.0]]
    assert found.derivative == pytest.approx(np.array(wanted), abs=2e-6)
    scaled = np.array(wanted) * list(wrt.values())
    assert found.covariance == pytest.approx(scaled @ scaled.T, rel=1e-4)
    assert found.std == pytest.approx(np.linalg.norm(scaled, axis=1), rel=1e-4)
    lines = list(found.sentences())
    assert lines[0].startswith("1 mm/s in initial.rates.robot/x changes the impulse of impact 1 by 0.1 %")
    assert lines[3] == "3 g in model.target.target.mass_kg does not change the time of impact 1"


def test_a_loaded_run_gives_the_same(of_place, tmp_path):
    ffsm_mj.run("coasting", {"duration_s": 5.5}, out=tmp_path / "a", rerun=False)
    found = ffsm_mj.sensitivity(ffsm_mj.load_run(tmp_path / "a"), "impacts.0.impulse_N_s", {PLACE: 1e-3})
    assert found.derivative == pytest.approx(of_place.derivative, rel=1e-12)
    assert found.table.columns["at_plus_sigma"] == pytest.approx(of_place.high[0], rel=1e-12)


def test_a_missed_impact_is_told(tmp_path):
    """At minus one standard deviation the ball is too slow to arrive within the run."""
    path = two_balls(tmp_path, speed=1.0, gap=0.8)
    found = ffsm_mj.sensitivity(ffsm_mj.run(path), (), {"initial.rates.robot/x": 0.3})
    assert found.same_impacts == (False,)
    assert next(found.sentences()) == "0.3 m/s in initial.rates.robot/x: the impulse of impact 1 does not exist in every run"


@pytest.mark.parametrize(
    ("of", "wrt", "kind", "message"),
    [
        ("impacts.0.impulse", {PLACE: 1e-3}, "secant", "impulse_N_s"),
        ((), {"initial.joints.object/q": 1e-3}, "secant", "object/q"),
        ((), {"initial.joints.object/y": 0.0}, "secant", "must be positive"),
        ((), {"robot.mjcf": 1.0}, "secant", "is not one number"),
        ((), {}, "secant", "nothing is uncertain"),
        ((), {PLACE: 1e-3}, "slope", "kind"),
        ("steps", {PLACE: 1e-3}, "exact", "steps has no derivative here"),
        ((), {"model.object.box.mass_kg": 0.1}, "exact", "no derivative by model.object.box.mass_kg"),
    ],
)
def test_bad_input_is_named(coasting, of, wrt, kind, message):
    with pytest.raises(InputError, match=message):
        ffsm_mj.sensitivity(coasting, of, wrt, kind)


def test_exact_refuses_control_before_the_impact_by_name():
    run = ffsm_mj.run("coasting", {"duration_s": 5.5, "phases.0.controller": {"kind": "hold", "bandwidth_Hz": 0.001}})
    with pytest.raises(InputError, match=r"exact: hold of phase 'coast' acts before the impact"):
        ffsm_mj.sensitivity(run, (), {PLACE: 1e-3}, "exact")


def test_uncertainties_of_a_scenario_are_in_the_report_of_its_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    path = two_balls(tmp_path, uncertainties={"initial.joints.target/x": 0.001, "initial.rates.robot/x": 0.001})
    assert main(["run", str(path), "--out", "a", "--no-rerun"]) == 0
    out = capsys.readouterr().out
    assert "1 mm in initial.joints.target/x changes the time of impact 1 by 0.001 s: 0.299 to 0.301 s" in out
    assert "1 mm/s in initial.rates.robot/x changes the impulse of impact 1 by 0.1 %" in out
    rows = (tmp_path / "a" / "sensitivity.csv").read_text().splitlines()
    assert rows[0].startswith("of,wrt,sigma,nominal,")
    assert len(rows) == 5
    stated = json.loads((tmp_path / "a" / "summary.json").read_text())["sensitivity"]
    assert all(sentence in out for sentence in stated["sentences"])
    assert [row["wrt"] for row in stated["rows"]] == [row.split(",")[1].strip('"') for row in rows[1:]]
    assert main(["analyze", "a"]) == 0
    assert all(sentence in capsys.readouterr().out for sentence in stated["sentences"][:1])
    assert main(["analyze", "a", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["sensitivity"] == stated["sentences"]
    assert html.escape(stated["sentences"][0]) in sensitivity_html(ffsm_mj.load_run("a"))
    assert main(["check", str(path)]) == 0
    assert "uncertain: 1 mm in initial.joints.target/x" in capsys.readouterr().out
    assert main(["run", "a", "--out", "b", "--no-rerun"]) == 0  # the scenario in the run folder has them too
    assert (tmp_path / "b" / "sensitivity.csv").read_text() == "\n".join([*rows, ""])


def test_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    path = str(two_balls(tmp_path))
    wrt = ["--wrt", "initial.joints.target/x=2mm"]
    assert main(["sensitivity", path, *wrt, "--of", "impacts.0.time_s", "--out", "a.csv"]) == 0
    assert "2 mm in initial.joints.target/x changes the time of impact 1 by 0.002 s" in capsys.readouterr().out
    assert main(["sensitivity", path, *wrt, "--exact", "--of", "impacts.0.time_s"]) == 0
    assert capsys.readouterr().out == "2 mm in initial.joints.target/x changes the time of impact 1 by 0.002 s\n"
    for options, message in (
        (["--wrt", "initial.joints.target/x"], "should be KEY=NUMBER"),
        (["--wrt", "initial.joints.target/x=1 inch"], "should be KEY=NUMBER"),
        (["--wrt", "initial.joints.targt/x=1mm"], "initial.joints.targt/x: unknown joint"),
        ([*wrt, "--of", "impact"], "--of impact: unknown metric"),
        ([], "nothing is uncertain"),
    ):
        assert main(["sensitivity", path, *options]) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1


def test_uncertainties_are_faults_of_their_line(tmp_path, capsys):
    path = two_balls(tmp_path, uncertainties={"initial.joints.targt/x": 0.001})
    assert main(["check", str(path)]) == 2
    assert f"{path}:1:" in (error := capsys.readouterr().err)
    assert "uncertainties.initial.joints.targt/x: unknown joint" in error


def test_sizes_read_well():
    assert in_words(0.001, "m") == "1 mm"
    assert in_words(0.25, "m") == "0.25 m"
    assert in_words(0.002, "rad/s") == "2 mrad/s"
    assert in_words(0.02, "") == "0.02"
