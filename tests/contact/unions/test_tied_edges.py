"""An edge that lies exactly on an edge: two convex bodies, whole or in pieces, with rates into both faces of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.persistent.record import ContactBegins
from tests.contact.unions.judge import sound
from tests.contact.unions.scenes import fixed, free, geoms, on
from tests.random_scenes.dice import Dice

HALF = 0.1
WHOLE = [((-1.0, -0.5, -0.5), (0.0, 0.5, 0.0))], [((-HALF, -HALF, -HALF), (HALF, HALF, HALF))]
"""A block whose upper edge is the y axis, and a cube."""
PIECES = (
    [((-1.0, -0.5, -0.5), (0.0, 0.02, 0.0)), ((-1.0, 0.02, -0.5), (0.0, 0.5, 0.0))],
    [((-HALF, -HALF, -HALF), (HALF, 0.03, HALF)), ((-HALF, 0.03, -HALF), (HALF, HALF, HALF))],
)


@dataclass(frozen=True)
class Tied:
    """Where the cube's lower edge lies on the block's upper one, and how it moves.

    Attributes:
        y: Its centre along the edge, m.
        rates: Its linear velocity and angular velocity, (6,).
        restitution: Coefficient of restitution.
        mu: Coefficient of friction.
        gravity: Gravity, m/s2.
    """

    y: float = 0.05
    rates: tuple[float, ...] = ()
    restitution: float = 0.0
    mu: float = 0.0
    gravity: float = 0.0

    def run(self, folder, pieces):
        """The run of 0.05 s by steps of 0.5 ms: truncation of one of 2 ms adds up to 5e-9 J, of these 1 / 256 of it."""
        block, cube = PIECES if pieces else WHOLE
        gravity = f'<option gravity="0 0 {-self.gravity}"/>'
        joints = [HALF, self.y, HALF, 1, 0, 0, 0]
        keys = {"restitution": self.restitution, "mu": self.mu, "duration_s": 0.05, "time_step_s": 5e-4}
        path = on(
            folder,
            free(geoms(cube, "g"), gravity=gravity),
            fixed(geoms(block), gravity=gravity),
            joints=joints,
            rates=self.rates,
            **keys,
        )
        return ffsm_mj.run(path)


def drawn(seed):
    """A cube that approaches both faces of the block; within the edge, flush with its end, or beyond it."""
    dice = Dice(seed, "tied edges")
    along = dice.pick((0.0, dice.between(-0.3, 0.3)))
    rates = (
        -dice.between(0.02, 0.5),
        along,
        -dice.between(0.02, 0.5),
        *(dice.between(-1.0, 1.0) * (seed % 2) for _ in range(3)),
    )
    place, restitution = (0.05, 0.4, 0.45)[seed // 2 % 3], dice.pick((0.0, 0.0, 0.5, 1.0))
    return Tied(place, rates, restitution, dice.pick((0.0, 0.3)), dice.pick((0.0, 9.81)))


@pytest.mark.parametrize("pieces", [False, True], ids=["whole", "pieces"])
@pytest.mark.parametrize("seed", [*range(6), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(6, 60))])
def test_it_runs_to_its_end(tmp_path, seed, pieces):
    """Checks pass and the log replay agrees, whatever the rates, restitution, friction and place along the edge."""
    sound(drawn(seed).run(tmp_path, pieces))


@pytest.mark.parametrize("pieces", [False, True], ids=["whole", "pieces"])
def test_the_edge_slides_on_the_face_that_turns_into_it(tmp_path, pieces):
    """At e = 0 the impulse m v I / (I + m a^2) stops the lower edge of the cube, which turns, along z alone.

    Then it leaves the block along x, and its lower face turns against the edge of the block, which slides on it from there
    at constant energy. The corners of the cube, which touch the upper face too, leave it.
    """
    mass, inertia, speed = 2.0, 0.008, 0.2
    run = sound(Tied(rates=(-0.3, 0, -speed, 0, 0, 0)).run(tmp_path, pieces))
    assert sum(impact.impulse_N_s for impact in run.impacts) == pytest.approx(
        mass * speed * inertia / (inertia + mass * HALF**2), abs=1e-12
    )
    assert all(impact.normal == pytest.approx((0.0, 0.0, -1.0)) for impact in run.impacts)
    assert [record.mode for record in run.log.events if isinstance(record, ContactBegins)] == ["edge on edge"]
    assert run["contact.hit_force_N"][1:].min() > 0.0
    x, z, pitch = run.qpos[:, 0], run.qpos[:, 2], 2.0 * np.arctan2(run.qpos[:, 5], run.qpos[:, 3])
    # The y axis in the axes of the cube: over its lower face.
    assert np.sin(pitch) * -x + np.cos(pitch) * -z == pytest.approx(-HALF, abs=1e-9)
    energy = 0.5 * mass * (run.qvel[:, 0] ** 2 + run.qvel[:, 2] ** 2) + 0.5 * inertia * run.qvel[:, 4] ** 2
    assert energy[1:] == pytest.approx(run.impacts[0].energy_after_J["total"][0], abs=1e-12)


def ends(first, second):
    """Rates of the cube whose lower edge has these velocities along x and z at y = -0.1 m and at y = 0.1 m, m/s."""
    (x, z), (u, w) = first, second
    return 0.5 * (x + u), 0.0, 0.5 * (z + w), 0.5 * (w - z) / HALF, 0.0, 0.5 * (x - u) / HALF


@pytest.mark.parametrize("pieces", [False, True], ids=["whole", "pieces"])
@pytest.mark.parametrize(
    ("first", "second", "impacts"),
    [
        ((0.5, -0.1), (-0.05, 1.0), False),  # n = (1, 1) has rates of 0.4 and 0.95 m/s
        ((0.05, -0.5), (-0.5, 0.05), True),  # midway both rates are -0.225 m/s
    ],
)
def test_a_turning_edge_parts_along_a_normal_between_those_of_the_faces(tmp_path, first, second, impacts, pieces):
    """One end opens along x, the other one along z: an impact if, and only if, a place between opens along neither."""
    run = sound(Tied(0.0, ends(first, second)).run(tmp_path, pieces))
    assert any(impact.time_s == 0.0 for impact in run.impacts) == impacts
