"""Wrong code of friction put in on purpose: runs of it are not reported as good."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.persistent import active_set, point_groups
from ffsm_mj.contact_models.persistent.friction import problem, stage
from tests.contact_models.persistent.friction.scenes import BALL_TIP, block, cube, gripped, sphere, thrust
from tests.contact_models.persistent.test_wrong_on_purpose import faults, judged


def sliding(folder):
    """A sphere that slides."""
    return sphere(folder, mu=0.2, velocity=(0.7, 0, 0), step=4e-3, duration=0.04)


def rolling(folder):
    """A sphere that rolls and spins."""
    return sphere(folder, mu=5.0, velocity=(0.5, 0, 0), spin=(0, 0.5, 5), step=4e-3, duration=0.04)


def turning(folder):
    """A block on four corners that slides and spins: the slip of each corner turns."""
    return block(folder, mu=0.3, velocity=(0.6, 0.2, 0.0), spin=4.0, step=4e-3, duration=0.04)


def pinched(folder):
    """A cube between two ball tips, which both let go at 0.5 s."""
    pull = [thrust((0, 0, 0), (200, 0, 0))]
    shape = {"base_kg": 17.0, "finger_kg": 0.5, "half_m": 0.5}
    return gripped(folder, BALL_TIP, cube(2.0, 0.5, 0.3), mu=0.5, grip_N=10.0, loads=pull, step=0.02, duration=0.6, **shape)


def swinging(folder):
    """A cube that swings about two ball tips, which stick."""
    held = cube(2.0, 0.05, 0.004, (0.02, 0, 0))
    return gripped(folder, BALL_TIP, held, mu=0.4, grip_N=10.0, loads=[thrust((0, 0, 12))], step=8e-3, duration=0.08)


@pytest.mark.parametrize("scene", [sliding, rolling, turning, pinched, swinging])
def test_right_code_is_good(tmp_path, scene):
    run = ffsm_mj.run(scene(tmp_path))
    assert faults(run) == judged(run) == set()


def test_friction_along_the_slip(tmp_path, monkeypatch):
    """It drives the sphere on: the log itself says that heat falls."""
    right = problem._Held.forces
    with monkeypatch.context() as wrong:
        wrong.setattr(problem._Held, "forces", lambda self, slips: right(self, -slips))
        run = ffsm_mj.run(sliding(tmp_path))
        assert "heat of sliding" in faults(run)
    assert judged(run)


def test_rates_of_the_tangents_at_a_point_fixed_to_the_body(tmp_path, monkeypatch):
    """The path of a spinning roller bends; other functions find other forces."""
    right = point_groups.SingleState.tangential_rows

    def of_the_body(self, axes, J, gamma):
        here, body = self._here, self._b
        rate = np.array(body.velocity) + np.cross(body.omega, np.array(here.point) - body.centre)
        self._here = here._replace(point_rate=tuple(rate.tolist()))
        right(self, axes, J, gamma)

    with monkeypatch.context() as wrong:
        wrong.setattr(point_groups.SingleState, "tangential_rows", of_the_body)
        run = ffsm_mj.run(rolling(tmp_path))
        assert "contact complementarity" in judged(run)
    assert judged(run)


def test_a_direction_of_slip_kept_for_a_whole_step(tmp_path, monkeypatch):
    right = stage.slip_directions

    def kept(now, slips, at_start, slides, *more):
        return at_start * slides[:, None], right(now, slips, at_start, slides, *more)[1]

    with monkeypatch.context() as wrong:
        wrong.setattr(stage, "slip_directions", kept)
        run = ffsm_mj.run(turning(tmp_path))
    assert "motion" in judged(run)


def test_heat_from_the_sizes_of_force_and_slip(tmp_path, monkeypatch):
    """The size of the force includes the normal one: heat is not what the energy lacks."""
    right = active_set.stage_of

    def sizes(here, implicit):
        found, generalised = right(here, implicit)
        return found._replace(
            heat=np.hypot(found.forces, np.linalg.norm(found.friction, axis=1)) * found.slip_speeds
        ), generalised

    with monkeypatch.context() as wrong:
        wrong.setattr(active_set, "stage_of", sizes)
        run = ffsm_mj.run(sliding(tmp_path))
        assert "heat of sliding" in faults(run)
    assert judged(run)
