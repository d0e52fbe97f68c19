"""Runs of contact models go on bit for bit from a state in their middle, out through bytes and back."""

from __future__ import annotations

import pytest

from tests.balance.test_tendon_springs import REACH
from tests.contact_models.grasp.scenes import BOUNDS, grasping
from tests.contact_models.grasp.test_latch_runs import docking
from tests.contact_models.grasp.test_moving_link import catching
from tests.contact_models.grasp.two_arms import holding
from tests.contact_models.joint_friction.scenes import rubbing
from tests.contact_models.joint_friction.test_chains import CORD_OF_A_HAND, ROUGH_JOINTS
from tests.contact_models.joint_friction.test_tendons import CORD, MOTORS, SWUNG
from tests.contact_models.test_tendon_limits import swung
from tests.mechanisms.test_grips import holding as held_by_a_linkage
from tests.simulation.restored import goes_on, is_rest_of

SCENES = {
    "an armed grasp": (lambda folder: grasping(folder, BOUNDS, duration_s=1.0), 0.5),
    "a soft latch": (lambda folder: docking(folder, "hinge"), 0.05),
    "a hard latch": (lambda folder: docking(folder, "hinge"), 0.15),
    "a latch of a link": (catching, 0.2),
    "two grasps": (holding, 0.295),
    "a linkage that holds a plate": (held_by_a_linkage, 0.1),
    "a linkage that held one": (held_by_a_linkage, 0.5),
    "a taut cord": (lambda folder: swung(folder, 2e-3), 0.7),
    "a cord that sticks": (lambda folder: rubbing(folder, REACH.format(CORD, MOTORS), 4e-3, **SWUNG), 0.85),
    "a grasp by rough joints": (lambda folder: grasping(folder, robot=ROUGH_JOINTS), 1.1),
    "a grasp by a rough cord": (lambda folder: grasping(folder, robot=CORD_OF_A_HAND), 1.1),
}
"""Scene, and a time at which its contact models watch, hold or carry something, s."""


@pytest.mark.usefixtures("example_contact_models")
@pytest.mark.parametrize("name", SCENES)
def test_a_run_goes_on_from_a_state(tmp_path, name):
    make, at_s = SCENES[name]
    assert is_rest_of(*goes_on(make(tmp_path), at_s))
