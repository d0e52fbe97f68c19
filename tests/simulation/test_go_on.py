"""What if: a logged run goes on from one of its instants."""

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError

SHORT = ["--no-rerun", "-s", "duration_s=0.6"]


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    """The arm taps a wall from 0.08 s on, and rests on it from 0.22 to 0.33 s."""
    folder = tmp_path_factory.mktemp("logged") / "tap"
    assert main(["run", "tap", "--out", str(folder), *SHORT]) == 0
    return folder


@pytest.mark.parametrize("from_s", [0.1, 0.1574, 0.25])
def test_without_changes_it_is_the_same_run(logged, from_s):
    """Bit for bit, from a tick, from the second impact, and from within contact that lasts."""
    whole, rest = ffsm_mj.load_run(logged), ffsm_mj.go_on(logged, from_s)
    assert rest.time[0] == pytest.approx(np.ceil(from_s / 0.005 - 1e-9) * 0.005, abs=1e-12)
    assert np.array_equal(whole.log.rows[-len(rest.log.rows) :], rest.log.rows, equal_nan=True)
    assert all(check.passes for check in rest.checks())


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


def test_a_changed_law_begins_there(logged):
    """The law of the phase begins anew; without a change it goes on with what it remembers."""
    same, softer = (ffsm_mj.go_on(logged, 0.4, given) for given in ({}, {"phases.1.controller.kp": [10.0]}))
    assert np.array_equal(same.qpos[0], softer.qpos[0])
    assert not np.array_equal(same.qpos[-1], softer.qpos[-1])


@pytest.mark.parametrize(
    ("from_s", "overrides", "message"),
    [
        (0.6, {}, "0.6 s is not an instant of the run, which lasts 0.6 s"),
        (-1.0, {}, "is not an instant of the run"),
        (0.1, {"seed": 3}, "seed: cannot change where a run goes on"),
        (0.1, {"time_step_s": 0.0025}, "time_step_s: cannot change"),
    ],
)
def test_what_cannot_be_is_refused(logged, from_s, overrides, message):
    with pytest.raises(InputError, match=message):
        ffsm_mj.go_on(logged, from_s, overrides)


def test_no_run_and_a_changed_file(logged, tmp_path):
    with pytest.raises(InputError, match="nothing: is no run folder that can go on: it has no"):
        ffsm_mj.go_on(tmp_path / "nothing", 1.0)
    scenario = logged / "scenario.yaml"
    text = scenario.read_text()
    scenario.write_text(text.replace("- 20.0", "- 21.0").replace("[20.0]", "[21.0]"))
    try:
        with pytest.raises(InputError, match=r"the run cannot be made again: at 0\.3 s its state"):
            ffsm_mj.go_on(logged, 0.3)
    finally:
        scenario.write_text(text)
