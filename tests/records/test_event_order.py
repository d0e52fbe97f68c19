"""Events at one instant are put in the order in which each begins where the one before it ends."""

from __future__ import annotations

import ffsm_mj
from ffsm_mj.log.recorded_files import recorded_efforts
from ffsm_mj.records.run_log import merged
from tests.contact_models.grasp.scenes import closed_as_armed


def jump(event, after):
    return abs(after[0] - event[1])


def test_an_impact_precedes_two_captures_whatever_they_do_to_the_state():
    """The second capture ends near where the impact began: compared one by one it would come before."""
    impact, first, second = (0.0, 1.0), (1.0, 10.0), (10.0, 0.5)
    assert merged([impact], [first, second], jump) == [impact, first, second]


def test_an_impact_between_two_captures():
    impact, first, second = (10.0, 0.5), (0.0, 10.0 + 1e-12), (0.5, 3.0)
    assert merged([impact], [first, second], jump) == [first, impact, second]


def test_records_of_one_instant_are_in_the_order_of_their_numbers(tmp_path):
    """By kind, the armings of the first phase would be the last, and playback of the run would begin with their efforts."""
    run = ffsm_mj.run(closed_as_armed(tmp_path))
    at_once = [each for each in run.log.events() if hasattr(each, "event") and each.time_s == 0.0]
    assert [each.event for each in at_once] == sorted(each.event for each in at_once)
    assert len({type(each) for each in at_once}) > 2
    keys, first, *_ = (line.split(",") for line in recorded_efforts(run.log).splitlines())
    efforts = dict(zip(keys, map(float, first), strict=True))
    released, armed = (run.records[kind][0].efforts_after["robot/elbow"][0] for kind in ("releases", "armings"))
    assert efforts["actuators.robot_elbow_applied_N_m"] == released != armed
