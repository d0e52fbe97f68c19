"""Wrong friction put in on purpose fails closed forms, and replays of its logs with the right code do not agree."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.persistent import closed_contacts
from ffsm_mj.contact_models.persistent.friction import choice
from ffsm_mj.contact_models.persistent.friction.modes import SLIDE, STICK
from tests.contact_models.persistent.friction import test_closed_forms as closed_forms
from tests.contact_models.persistent.friction import test_slip_in_space as slip_in_space
from tests.contact_models.persistent.friction.reading import final
from tests.contact_models.persistent.friction.scenes import BALL_TIP, block, cube, gripped, load, sphere, thrust
from tests.contact_models.persistent.test_wrong_on_purpose import faults, judged


def freed_one_at_a_time(monkeypatch):
    """Of the points beyond their limit only one is freed; the others stick until the next choice of modes."""

    def wrong(self):
        still = self._still
        kinds = np.where(still, np.where(self._states.kinds == SLIDE, SLIDE, STICK), SLIDE)
        directions = self._directions(kinds)
        found = self.evaluate(kinds, directions)
        friction = np.hypot(*found.forces[:, 1:].T)
        first = np.argmax(np.where(kinds == STICK, friction - self._problem.mu * found.forces[:, 0], -np.inf))
        kinds[first], directions[first] = SLIDE, -found.forces[first, 1:] / friction[first]
        return self.evaluate(kinds, directions)

    monkeypatch.setattr(choice.ModeChoice, "_solved", wrong)


def explicit_stages(monkeypatch):
    """All stages are explicit, however fast friction turns the slip."""
    right = closed_contacts.step_rule
    monkeypatch.setattr(
        closed_contacts, "step_rule", lambda *given: right(*given)._replace(limit_s=given[2], implicit=False)
    )


def sliding_block(tmp_path):
    closed_forms.test_a_sliding_block(tmp_path, 0.0)


def spinning_roller(tmp_path):
    """For 0.02 s, in which a mistake turns its velocity by milliradians."""
    run = ffsm_mj.run(sphere(tmp_path, mu=5.0, velocity=(0.5, 0, 0), spin=(0, 0.5, 5), step=4e-3, duration=0.02))
    np.testing.assert_allclose(final(run, "v_robot_free")[:3], [0.5, 0, 0], atol=1e-12)


def spinning_block(tmp_path):
    slip_in_space.test_a_block_slides_and_spins_on_four_corners(tmp_path, 4e-3)


def curving_foot(tmp_path):
    slip_in_space.test_a_foot_breaks_away_along_a_curve(tmp_path, 4e-3)


def test_a_spinning_roller_goes_straight_on(tmp_path):
    spinning_roller(tmp_path)


@pytest.mark.long
@pytest.mark.parametrize(
    ("mistake", "noticed_by"),
    [
        (explicit_stages, curving_foot),
    ],
)
def test_a_mistake_fails_a_closed_form(tmp_path, monkeypatch, mistake, noticed_by):
    mistake(monkeypatch)
    with pytest.raises(AssertionError):
        noticed_by(tmp_path)


def slides(folder):
    """A block that slides and spins on its corners."""
    return block(folder, mu=0.3, velocity=(0.6, 0.2, 0.0), spin=4.0, step=4e-3, duration=0.02)


def breaks_away(folder):
    """A block at rest that a side load beyond the limit of friction pulls away."""
    pull = load("robot/box", force_N=[[2.0, 3.0, 0]], at_m=[0, 0, -0.05])
    return block(folder, mu=0.3, velocity=(0, 0, 0), weight=10.0, step=4e-3, duration=0.02, loads=[pull])


def rolls(folder):
    """A sphere that rolls and spins."""
    return sphere(folder, mu=5.0, velocity=(0.5, 0, 0), spin=(0, 0.5, 5), step=4e-3, duration=0.02)


def pulled_out(folder):
    """A cube between two balls, which the thrust of their base pulls off it."""
    held = cube(2.0, 0.05, 0.004)
    return gripped(folder, BALL_TIP, held, mu=0.4, grip_N=5.0, loads=[thrust((0, 0, 36))], step=4e-3, duration=0.02)


@pytest.mark.parametrize("scene", [slides, breaks_away, pulled_out, rolls])
def test_right_code_is_good(tmp_path, scene):
    run = ffsm_mj.run(scene(tmp_path))
    assert faults(run) == judged(run) == set()


FORCES = {"contact complementarity"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("mistake", "scene", "by_the_log", "by_the_states"),
    [
        (freed_one_at_a_time, breaks_away, set(), FORCES),
        (freed_one_at_a_time, pulled_out, set(), FORCES),
    ],
)
def test_a_mistake_is_noticed_in_the_log(tmp_path, monkeypatch, mistake, scene, by_the_log, by_the_states):
    with monkeypatch.context() as wrong:
        mistake(wrong)
        run = ffsm_mj.run(scene(tmp_path))
        assert faults(run) == by_the_log
    assert by_the_states <= judged(run)
