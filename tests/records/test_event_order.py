"""The order of events is that of the log, also at one instant."""

from __future__ import annotations

import ffsm_mj
from ffsm_mj.log.recorded_files import recorded_efforts
from tests.contact_models.grasp.scenes import closed_as_armed


def test_records_of_one_instant_are_in_the_order_of_their_numbers(tmp_path):
    """By kind, the armings of the first phase would be the last, and playback of the run would begin with their efforts."""
    run = ffsm_mj.run(closed_as_armed(tmp_path))
    at_once = [each for each in run.log.events if hasattr(each, "event") and each.time_s == 0.0]
    assert [each.event for each in at_once] == sorted(each.event for each in at_once)
    assert len({type(each) for each in at_once}) > 2
    keys, first, *_ = (line.split(",") for line in recorded_efforts(run.log).splitlines())
    efforts = dict(zip(keys, map(float, first), strict=True))
    released, armed = (run.records[kind][0].efforts_after["robot/elbow"][0] for kind in ("releases", "armings"))
    assert efforts["actuators.robot_elbow_applied_N_m"] == released != armed
