"""Two example contact models: a spring in persistent contact, and a weld that replaces the motion."""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_controllers.off import Off
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact_models.interface import EventTime
from ffsm_mj.contact_models.persistent.record import ContactEnds
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.errors import InputError
from ffsm_mj.records.events import Outcome, RunEnded
from ffsm_mj.replay import replay_log
from tests.contact_models import scenes
from tests.contact_models.weld import Weld
from tests.replays import assert_passes
from tests.scenes import ball, two_balls

pytestmark = pytest.mark.usefixtures("example_contact_models")


@pytest.mark.long
def test_a_spring_stores_and_returns_energy(tmp_path):
    """Two masses and a spring: 0.344 s in contact, half a period pi sqrt(mu / k), apart from the tangential motion.

    The balance knows its force only through the wrenches that it reports.
    """
    seen = ffsm_mj.run(scenes.spring(tmp_path))
    assert_passes(seen)
    begins, ceases = seen.records["springs"]
    assert (begins.pushing, ceases.pushing) == (1, 0)
    half_period = math.pi * math.sqrt(2.0 * 3.0 / 5.0 / 100.0)
    assert ceases.time_s - begins.time_s == pytest.approx(half_period, rel=0.05)
    force = seen["contact.spring_force_N"]
    during = (seen.time > begins.time_s) & (seen.time < ceases.time_s)
    assert np.all((force > 0.0) == during)
    # At its deepest nearly all of the energy of approach, mu u^2 / 2, is in the spring: (max F)^2 / 2 k.
    assert force.max() ** 2 / 200.0 == pytest.approx(0.5 * 1.2 * 0.25, rel=0.05)
    # The balance says the same of it as the force: what the subsystems lost is in the spring.
    given = seen["balance.total_impact_energy_J"]
    assert given == pytest.approx(-(force**2) / 200.0, abs=1e-10)


def test_a_step_with_a_contact_model_in_its_stages_is_of_order_four(tmp_path):
    """Half the step leaves a sixteenth of the residual of the balance, down to 1e-9; a missing stage leaves more."""
    left = [
        max(
            abs(check.drift)
            # The tolerance selects no residual here: checks that fail would be explained by replays in shorter steps.
            for check in all_checks(ffsm_mj.run(scenes.spring(tmp_path, 1e4, step)), tolerance=1.0)
            if check.name == "linear momentum"
        )
        for step in (2e-3, 1e-3, 5e-4)
    ]
    orders = np.log2(np.divide(left[:-1], left[1:]))
    assert np.all(orders > 3.8), (left, orders)


def test_a_weld_moves_another_model_from_its_touch_to_its_release(tmp_path, monkeypatch):
    """Joined, swung by the elbow, released: total momenta to rounding, energy except the loss of the plastic impulse."""

    def swing_and_release(_, observation, command):
        if observation.time_s > 0.5:
            command.drive(slice(0, 1), np.array([0.3]))
        if observation.time_s == 1.5:
            command.requests.add("weld.release")

    monkeypatch.setattr(Off, "control", swing_and_release)
    seen = ffsm_mj.run(scenes.capture(tmp_path), out=tmp_path / "run")
    assert seen.outcome == "completed", seen.message
    grip, release = seen.records["welds"]
    assert (grip.held, release.held, release.time_s) == (1, 0, pytest.approx(1.5, abs=1e-12))
    assert grip.loss_J > 1e-3
    assert [(phase.name, phase.reason) for phase in seen.phases] == [("wait", "start"), ("hold", "weld")]
    assert all(check.passes for check in all_checks(seen)), [check for check in all_checks(seen) if not check.passes]
    for component in ("P_x_N_s", "P_y_N_s", "P_z_N_s", "L_x_N_m_s", "L_y_N_m_s", "L_z_N_m_s"):
        total = seen[f"momentum.total_{component}"]
        assert np.ptp(total) < 1e-12 * (1.0 + np.abs(total).max())
    # While it is held the two are one body: the distance of their points does not change, to rounding.
    held = seen["contact.weld_held"] == 1.0
    assert held.sum() > 500
    assert np.all(np.diff(held.astype(int))[seen.time[:-1] > grip.time_s + 2e-3] <= 0)


def test_a_welded_object_has_the_mass_of_the_scenario(tmp_path):
    """A contact model that compiles the scene anew uses the same parts: the masses of the files change the momentum."""
    path = scenes.capture(tmp_path)
    tree, body = "target", "target"
    seen = ffsm_mj.run(path, {f"model.{tree}.{body}.mass_kg": 4.0, "duration_s": 1.0})
    assert len(seen.records["welds"]) > 0
    assert all(check.passes for check in all_checks(seen)), [check for check in all_checks(seen) if not check.passes]


def test_an_impact_on_a_welded_object_acts_on_robot_and_object(tmp_path):
    """A third body hits the welded object: resolved in the motion, total momenta and (e = 1) energy are conserved.

    Resolved as if it were free, the object would leave the hand, and the weld would take the energy.
    """
    initial = {
        "joints": {"target/free": [1.0, 0.03, 0.02, 1, 0, 0, 0], "stone/free": [1.6, 0.05, 0, 1, 0, 0, 0]},
        "rates": {"target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3], "stone/free": [-0.6, 0, 0, 0, 0, 0]},
    }
    hit = [{"name": "late", "between": ["stone/stone", "target/target"]}]
    path = scenes.capture(tmp_path, {"stone": ball("stone", mass=0.5)}, initial=initial, contacts={"rules": hit})
    seen = ffsm_mj.run(path, out=tmp_path / "run")
    (grip,) = seen.records["welds"]
    (impact,) = seen.impacts
    assert impact.time_s > grip.time_s
    assert abs(impact.energy_change_J) < 1e-12
    assert impact.linear_momentum_change_N_s < 1e-12
    assert impact.separation_speed_m_s == pytest.approx(impact.approach_speed_m_s, rel=1e-12)
    before, after = (np.array(qvel["robot/free"]) for qvel in (impact.qvel_before, impact.qvel_after))
    assert np.abs(after - before).max() > 1e-3  # the robot feels it at once
    assert all(check.passes for check in all_checks(seen)), [check for check in all_checks(seen) if not check.passes]
    assert replay_log(seen.log).agrees, replay_log(seen.log).worst


def test_a_run_may_end_at_an_event_of_a_contact_model(tmp_path, monkeypatch):
    """The last sample is there, between two ticks, and the log is not damaged."""
    act = Weld.act
    monkeypatch.setattr(Weld, "act", lambda self, instant: act(self, instant)._replace(end=RunEnded(Outcome.COMPLETED)))
    ffsm_mj.run(scenes.capture(tmp_path), out=tmp_path / "run")
    seen = ffsm_mj.load_run(tmp_path / "run")
    (grip,) = seen.records["welds"]
    assert (seen.outcome, seen.time[-1], seen.damage) == ("completed", grip.time_s, "")
    assert replay_log(seen.log).agrees, replay_log(seen.log).worst
    assert not replay_log(seen.log).gaps


def test_an_unknown_request_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(Off, "control", lambda _, __, command: command.requests.add("weld.relase"))
    seen = ffsm_mj.run(scenes.capture(tmp_path), out=tmp_path / "run", check=False)
    assert seen.outcome == "controller_failed"
    assert "unknown request 'weld.relase'" in seen.message
    assert "weld.release" in seen.message


@pytest.mark.parametrize(
    ("contact_models", "place", "what"),
    [
        ([{"kind": "sprang"}], "contact_models.0.kind", "unknown contact model 'sprang' (did you mean 'spring'?)"),
        ([{"between": ["hand", "target/target"]}], "contact_models.0", "needs a 'kind'; allowed: drive, spring, weld"),
        ([{"kind": "spring", "geoms": ["hand"], "stiffness_N_m": 1.0}], "contact_models.0.geoms", "at least 2 items"),
        ([{"kind": "spring", "geoms": ["hand", "no"], "stiffness_N_m": 1.0}], "contact_models.0", "unknown geom 'no'"),
    ],
)
def test_faults_of_a_declared_contact_model_have_a_position(tmp_path, contact_models, place, what):
    phases = [{"name": "coast", "until": "end", "controller": {"kind": "off"}}]
    with pytest.raises(InputError) as error:
        prepare(scenes.capture(tmp_path, contact_models=contact_models, phases=phases))
    (line,) = error.value.lines
    assert f": {place}: " in line
    assert what in line


def test_a_phase_ends_only_with_known_events(tmp_path):
    with pytest.raises(InputError) as error:
        prepare(scenes.capture(tmp_path, contact_models=[]))
    assert "phases.0.until: unknown end of a phase 'weld'" in str(error.value)


def test_what_a_contact_model_imports_is_on_its_page():
    """``docs/contact-models.md`` names every module of the package that the contact models here import."""
    page = Path("docs/contact-models.md")
    root = Path(__file__).parents[2]
    named = set(re.findall(r"`(ffsm_mj\.[a-z_.]+)`", (root / page).read_text()))
    for file in ("spring.py", "weld.py"):
        used = set(re.findall(r"^from (ffsm_mj[a-z_.]*) import", (Path(__file__).parent / file).read_text(), re.MULTILINE))
        assert {module for module in used if not any(module == n or module.startswith(f"{n}.") for n in named)} == set()


def test_no_persistent_contact_in_another_motion(tmp_path):
    """Its forces would act through the weld: such a contact neither begins nor continues."""
    parts = prepare(two_balls(tmp_path, speed=0.0, gap=0.0, restitution=0.0)).assemble()
    (pair,), (impacts, lasting, *_) = parts.pairs, parts.plant.integrator.sources
    assert (lasting.refusal(pair), lasting.holds(pair)) == ("", True)
    lasting.act(EventTime(0.0, 0))  # it is told of
    parts.plant.integrator.bind(Motion(parts.system.mj, mujoco.MjData(parts.system.mj)))
    assert "another model" in lasting.refusal(pair)
    assert [kind.kind for kind in (impacts, lasting) if kind.due()] == ["contact"]
    (record,) = lasting.act(EventTime(0.0, 0)).records
    assert type(record) is ContactEnds
    assert not lasting.holds(pair)
