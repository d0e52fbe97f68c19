"""What if: a logged run goes on from one of its instants."""

import shutil

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare, prepare_from
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.experiments.planning import load_campaign
from ffsm_mj.log.run_folder import RunFolder
from ffsm_mj.records.metadata import phase_graph_metadata
from ffsm_mj.report.plots.subject import Subject
from ffsm_mj.report.plots.time_series import energies
from ffsm_mj.report.run_report import details
from tests.contact_models.persistent.test_steady import held
from tests.controllers.test_script_laws import Damp, settle

SHORT = ["--no-rerun", "-s", "duration_s=0.6"]


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    """The arm taps a wall from 0.08 s on, and rests on it from 0.22 to 0.33 s."""
    folder = tmp_path_factory.mktemp("logged") / "tap"
    assert main(["run", "tap", "--out", str(folder), *SHORT]) == 0
    return folder


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("from_s", [0.1, 0.1574, 0.25])
def test_without_changes_it_is_the_same_run(logged, from_s):
    """Bit for bit, from a tick, from the second impact, and from within contact that lasts."""
    whole, rest = ffsm_mj.load_run(logged), ffsm_mj.resume(logged, from_s)
    assert rest.time[0] == pytest.approx(np.ceil(from_s / 0.005 - 1e-9) * 0.005, abs=1e-12)
    assert np.array_equal(whole.log.rows[-len(rest.log.rows) :], rest.log.rows, equal_nan=True)
    assert all(check.passes for check in all_checks(rest))


def test_a_slide_goes_on(tmp_path):
    """From within a slide, bit for bit: slip, heat and overlap are columns that its steps add to."""
    whole = ffsm_mj.run(held(tmp_path, mu=0.1, squeeze=1.0, slip=0.05), out=tmp_path / "slide", rerun=False)
    rest = ffsm_mj.resume(tmp_path / "slide", 0.02)
    assert whole["contact.robot_box_mode"][-1] == 4.0
    assert np.array_equal(whole.log.rows[-len(rest.log.rows) :], rest.log.rows, equal_nan=True)
    assert rest["contact.robot_box_heat_J"][-1] > rest["contact.robot_box_heat_J"][0] > 0.0
    (contact,), slip = rest.contacts, rest["contact.robot_box_slip_m"]
    assert (contact.rule, len(contact.pairs), contact.start_s, contact.end_s) == ("robot-box", 1, rest.time[0], None)
    assert contact.sliding_s == pytest.approx(rest.time[-1] - rest.time[0], abs=1e-12)
    assert contact.slip_m == pytest.approx(slip[-1] - slip[0], abs=1e-12)


def test_a_contact_that_lasts_is_told_from_the_first_row_on(logged, tmp_path):
    """No record of the run has its beginning; its impulse is what the original's has left."""
    (whole,) = (one for one in ffsm_mj.load_run(logged).contacts if one.start_s < 0.25 < (one.end_s or 0.0))
    rest = ffsm_mj.resume(logged, 0.25, out=tmp_path / "rest", rerun=False)
    (contact,), impulse = rest.contacts, rest["contact.paddle_impulse_N_s"]
    assert (contact.rule, contact.pairs) == (whole.rule, whole.pairs)
    assert (contact.start_s, contact.end_s) == (rest.time[0], whole.end_s)
    assert 0.0 < contact.impulse_N_s == pytest.approx(impulse[-1] - impulse[0], abs=1e-12)
    assert ffsm_mj.load_run(tmp_path / "rest").contacts == rest.contacts


def test_settings_change_there_and_not_before(logged, tmp_path, capsys):
    """Plastic from 0.1 s on: the next impact separates nothing; the replay of the new log begins with the state."""
    out = tmp_path / "plastic"
    assert (
        main(["run", str(logged), "--from", "0.1", "-s", "contacts.rules.0.restitution=0", "--out", str(out), "--no-rerun"])
        == 0
    )
    assert "; 0.1 to 0.6 s simulated" in capsys.readouterr().out
    whole, plastic = ffsm_mj.load_run(logged), ffsm_mj.load_run(out)
    assert plastic.impacts[0].time_s == whole.impacts[1].time_s
    assert whole.impacts[1].separation_speed_m_s > 0.01
    assert plastic.impacts[0].separation_speed_m_s == pytest.approx(0.0, abs=1e-12)
    assert plastic.impacts[0].event == 1
    assert main(["analyze", str(out)]) == 0
    assert "columns agree with states" in capsys.readouterr().out


def test_phases_before_the_instant_are_not_missed(logged):
    """Its first phase is over at 0.4 s. Where phases branch, those are missed to which a way leads from there."""
    whole, rest = ffsm_mj.load_run(logged), ffsm_mj.resume(logged, 0.4)
    assert [phase.name for phase in whole.phases] == ["tap_1", "back_1"]
    assert [phase.name for phase in rest.phases] == ["back_1"]
    missed = "phases not reached: wait_1, tap_2, back_2, wait_2, tap_3, back_3, wait_3, tap_4, rest"
    assert missed in details(whole)
    assert missed in details(rest)
    ways = phase_graph_metadata([(0, "impact", 1), (1, "impact", 2), (2, "impact", 1), (1, "time 1 s", 10)])
    rest.log.header.metadata.update(ways)
    assert "phases not reached: wait_1, rest" in details(rest)
    rest.log.header.metadata.update(phase_graph_metadata([(1, "impact", 2), (2, "impact", 0)]))
    assert "phases not reached: tap_1, wait_1" in details(rest)


def test_a_changed_law_begins_there(logged):
    """The law of the phase begins anew; without a change it goes on with what it remembers."""
    same, softer = (ffsm_mj.resume(logged, 0.4, given) for given in ({}, {"phases.1.controller.kp": [10.0]}))
    assert np.array_equal(same.qpos[0], softer.qpos[0])
    assert not np.array_equal(same.qpos[-1], softer.qpos[-1])


def test_a_gain_of_a_later_phase_begins_the_law_anew_and_says_so(logged, tmp_path, capsys):
    """Before the run, where it is described, and in a comparison, which names what the second run goes on from."""
    later = "phases.rest.controller.kp=[10.0]"
    for given, notes in ([], 0), ([later], 1):
        prepared = prepare_from(logged, 0.2, given)
        said = f"phases or task are not those of {logged}: the control law of the phase under way begins anew at 0.2 s"
        assert prepared.notes().count(said) == notes
        assert prepared.describe().count(f"note: {said}") == notes
    runs = [str(tmp_path / name) for name in ("same", "softer")]
    assert main(["run", str(logged), "--from", "0.2", "--out", runs[0], "--no-rerun"]) == 0
    assert main(["run", str(logged), "--from", "0.2", "-s", later, "--out", runs[1], "--no-rerun"]) == 0
    assert "begins anew at 0.2 s" in " ".join(capsys.readouterr().out.split())
    law = ", where phases or task change: the control law of the phase under way begins anew"
    for run, anew in ((runs[0], ""), (runs[1], law)):
        assert main(["analyze", str(logged), run, "--compare"]) == 0
        said = capsys.readouterr().out.splitlines()
        assert f"  the second run goes on from another one at 0.2 s{anew}" in said
        assert not any("before" in line and "differs" in line for line in said)
    assert main(["analyze", *runs, "--compare"]) == 0
    assert "goes on from" not in capsys.readouterr().out  # both go on from the same instant of the same run


PATH = {"kind": "joint_path", "joints": ["stroke"], "bandwidth_Hz": 1.0, "waypoints": [{"at_s": 0.2, "positions": [0.1]}]}
"""A law of another kind: it has columns and reports of its own, and remembers where it began."""


@pytest.mark.long
def test_a_law_of_another_kind_acts_as_if_it_had_always_been_there(logged, tmp_path, capsys):
    """Bit for bit the run that had it from t = 0, as its phase begins after the instant; columns are those of its log."""
    given = {"phases.back_1.controller": PATH}
    whole = ffsm_mj.run("tap", given | {"duration_s": 0.6})
    rest = ffsm_mj.resume(logged, 0.2, given, out=tmp_path / "rest", rerun=False)
    assert [phase.controller for phase in rest.phases] == ["pd", "joint_path"]
    assert whole.keys == rest.keys != ffsm_mj.load_run(logged).keys
    assert np.array_equal(whole.log.rows[-len(rest.log.rows) :], rest.log.rows, equal_nan=True)
    again = ffsm_mj.resume(tmp_path / "rest", 0.45)
    assert np.array_equal(whole.log.rows[-len(again.log.rows) :], again.log.rows, equal_nan=True)
    assert main(["analyze", str(tmp_path / "rest")]) == 0
    assert "columns agree with states" in capsys.readouterr().out


def test_a_law_of_another_kind_begins_without_memory(logged):
    """In the midst of its phase it begins at the state there; a law that did nothing in a phase reports nothing of it."""
    given = {"phases.tap_1.controller": PATH, "phases.back_1.controller": PATH}
    rest, before = ffsm_mj.resume(logged, 0.4, given), ffsm_mj.load_run(logged)
    assert np.array_equal(rest.qpos[0], before.qpos[-len(rest.qpos)])
    assert [phase["name"] for phase in rest.summary()["controller"]["phases"]] == ["back_1"]
    assert rest.phases[0].controller == "joint_path"
    assert all(check.passes for check in all_checks(rest))


@pytest.mark.parametrize(
    ("from_s", "overrides", "message"),
    [
        (0.6, {}, "from_s 0.6: 0.6 s is not an instant of .*, which lasts from 0 to 0.6 s"),
        (-1.0, {}, "from_s -1: should be greater than 0"),
        (0.1, {"seed": 3}, "seed: cannot change where a run goes on"),
        (0.1, {"time_step_s": 0.0025}, "time_step_s: cannot change"),
    ],
)
def test_what_cannot_be_is_refused(logged, from_s, overrides, message):
    with pytest.raises(InputError, match=message):
        ffsm_mj.resume(logged, from_s, overrides)


def test_no_run_and_a_changed_file(logged, tmp_path):
    with pytest.raises(InputError, match="nothing: is no run folder that can go on: it has no"):
        ffsm_mj.resume(tmp_path / "nothing", 1.0)
    scenario = logged / "scenario.yaml"
    text = scenario.read_text()
    scenario.write_text(text.replace("- 20.0", "- 21.0").replace("[20.0]", "[21.0]"))
    try:
        with pytest.raises(InputError, match=r"the run cannot be made again: at 0\.3 s its state"):
            ffsm_mj.resume(logged, 0.3)
    finally:
        scenario.write_text(text)


def later(logged, folder, text="", begin="{from: tap, at_s: 0.1}"):
    """A scenario file that goes on from a copy of the logged run beside it."""
    shutil.copytree(logged, folder / "tap")
    file = folder / "later.yaml"
    file.write_text(f"extends: tap/scenario.yaml\nname: later\ninitial: {begin}\n{text}")
    return file


PLASTIC = "contacts: {rules: [{name: paddle, restitution: 0.0}, {name: wall}]}\n"


@pytest.mark.long
def test_a_scenario_goes_on_from_a_run(logged, tmp_path, capsys):
    """The same as ``--from``; its folder can be run and continued when the other run is gone, and when it is gone itself."""
    file = later(logged, tmp_path, PLASTIC)
    whole = ffsm_mj.resume(logged, 0.1, {"contacts.rules.paddle.restitution": 0.0})
    prepared, out = prepare(file), tmp_path / "out"
    assert f"  goes on from {tmp_path / 'tap'} at t = 0.1 s" in prepared.describe()
    prepared.run(folder=RunFolder(out), rerun=False)
    shutil.rmtree(tmp_path / "tap")
    again = ffsm_mj.run(out / "scenario.yaml", out=tmp_path / "again", rerun=False).log.rows[:]
    shutil.copytree(tmp_path / "again", tmp_path / "moved")
    for folder in (out, tmp_path / "again"):
        shutil.rmtree(folder)
    rest = ffsm_mj.resume(tmp_path / "moved", 0.25)
    assert np.array_equal(whole.log.rows, again, equal_nan=True)
    assert len(rest.log.rows) == 71
    assert np.array_equal(whole.log.rows[-71:], rest.log.rows, equal_nan=True)
    assert all(check.passes for check in all_checks(rest))
    assert main(["analyze", str(tmp_path / "moved")]) == 0
    assert "columns agree with states" in capsys.readouterr().out


def test_a_simulator_begins_where_the_scenario_does(logged, tmp_path):
    """Each reset; a state restored in it too."""
    whole = ffsm_mj.load_run(logged)
    with ffsm_mj.Simulator(later(logged, tmp_path)) as simulator:
        for _ in range(2):
            assert simulator.reset().time_s == pytest.approx(0.1, abs=1e-12)
        simulator.step(until=0.2)
        state = simulator.get_state()
        simulator.step(until=0.3)
        simulator.set_state(state)
        while not simulator.step().ended:
            pass
        rows = simulator.close().log.rows
    assert len(rows) == 81
    assert np.array_equal(whole.log.rows[-81:], rows, equal_nan=True)


FROM = "{from: tap, at_s: 0.1}"


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize(
    ("begin", "text", "message"),
    [
        ("{from: nothing, at_s: 0.1}", "", r"3:11: initial\.from: no such run .*nothing"),
        ("{from: ., at_s: 0.1}", "", r"initial\.from: .* is no run folder that can go on: it has no scenario.yaml"),
        (
            "{from: tap, at_s: 0.6}",
            "",
            r"3:22: initial\.at_s: 0\.6 s is not an instant of .*tap, which lasts from 0 to",
        ),
        ("{from: tap, at_s: 0.2}", "duration_s: 0.2", r"initial\.at_s: 0\.2 s is not before the end, 0.2 s"),
        ("{from: tap}", "", r"initial: 'from' and 'at_s' belong together"),
        (FROM, "seed: 3", r"4:1: seed: cannot change where a run goes on, but is not that of .*tap"),
        ("{from: tap, at_s: 0.1, rates: {drive: 1.0}}", "", r"initial\.rates.*: cannot change where a run goes on"),
        (FROM, "model: {ball: {ball: {mass_kg: 2.0}}}", r"model.*: cannot change where a run goes on"),
        (FROM, "phases: [{name: a, until: end, controller: {kind: off}}]", r"4:1: phases: where a run goes on, values may"),
        (FROM, "contacts: {rules: [{name: wall}]}", r"4:1: contacts: where a run goes on, values may change, but not the"),
    ],
)
def test_faults_of_a_scenario_that_goes_on(logged, tmp_path, begin, text, message):
    with pytest.raises(InputError, match=message):
        prepare(later(logged, tmp_path, text, begin))


def test_a_run_does_not_go_on_from_itself(logged, tmp_path):
    shutil.copytree(logged, tmp_path / "tap")
    file = tmp_path / "tap" / "scenario.yaml"
    file.write_text(file.read_text().replace("initial:", "initial:\n  from: .\n  at_s: 0.1"))
    with pytest.raises(InputError, match=r"initial\.from: .*tap begins at an instant of itself"):
        prepare(file)


def test_a_campaign_begins_at_the_start(logged, tmp_path):
    """Each of its runs has a seed of its own, from the start on."""
    later(logged, tmp_path)
    varied = "dispersions: {contacts.rules.wall.restitution: {uniform: [0.5, 0.9]}}"
    text = f"campaign: try\nscenario: later.yaml\nsamples: {{kind: random, n: 2}}\n{varied}\n"
    (tmp_path / "campaign.yaml").write_text(text)
    with pytest.raises(
        InputError, match=r"later.yaml:3:11: initial\.from: a campaign needs a scenario that begins at t = 0"
    ):
        load_campaign(tmp_path / "campaign.yaml")


def test_figures_begin_where_the_run_does(logged):
    """Its work and losses before are not drawn, as its change of energy is counted from there; nor is the time before."""
    figure = energies(Subject(ffsm_mj.resume(logged, 0.2)))
    curves = {line.get_label(): line.get_ydata() for line in figure.axes[1].lines}
    assert np.ptp(curves["energy change"]) > 0.1
    np.testing.assert_allclose(curves["work + impacts"], curves["energy change"], atol=1e-9)
    assert all(axes.get_xlim() == pytest.approx((0.2, 0.6), abs=1e-9) for axes in figure.axes)


def test_an_error_of_a_constructor_is_raised_again(tmp_path):
    """As by ``ffsm_mj.run``; otherwise it is a fault of the scenario."""

    class Fragile(Damp):
        is_broken = False

        def __init__(self, config, context):
            super().__init__(config, context)
            if self.is_broken:
                raise ZeroDivisionError("in the law")

    laws = {"fragile": Fragile}
    ffsm_mj.run(
        "coasting", settle(kind="fragile") | {"duration_s": 0.1}, controllers=laws, out=tmp_path / "run", rerun=False
    )
    Fragile.is_broken = True
    with pytest.raises(InputError, match="in the law"):
        ffsm_mj.resume(tmp_path / "run", 0.05, controllers=laws, check=False)
    with pytest.raises(ZeroDivisionError, match="in the law"):
        ffsm_mj.resume(tmp_path / "run", 0.05, controllers=laws)
