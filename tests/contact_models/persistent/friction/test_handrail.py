"""The shipped scenario ``handrail``: pads of a gripper slide over the joint of two bars of a frame, then hold it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.assembly.prepare import prepare
from tests.replays import proved

PRESS_N, MU = 0.35, 0.3
JOINT_M, PAD_M = 0.02, 0.013
"""Joint of rail and rung from the middle of the rail, and half width of a pad."""


def pads_on_bar(run):
    """Place of the left pad in the axes of the frame from the middle of the rail, by row, (n, 3), m."""
    model = prepare("handrail").system.mj
    data = mujoco.MjData(model)
    pad, frame, rail = model.geom("robot/left_pad").id, model.body("frame/frame").id, model.geom("frame/rail_near_middle").id
    places = []
    for data.qpos[:] in run.qpos:
        mujoco.mj_kinematics(model, data)
        places.append(data.xmat[frame].reshape(3, 3).T @ (data.geom_xpos[pad] - data.geom_xpos[rail]))
    return np.array(places)


def test_the_frame_is_one_solid_of_twelve_bars():
    """Its volume is that of two rails of 1.2 m and six rungs of 0.56 m, and no two bars overlap."""
    system = prepare("handrail").system
    sizes = [system.mj.geom_size[g] for g in range(system.mj.ngeom) if system.mj.geom(g).name.startswith("frame/")]
    assert len(sizes) == 12
    assert sum(8.0 * float(np.prod(size)) for size in sizes) == pytest.approx(0.04**2 * (2 * 1.2 + 6 * 0.56), rel=1e-12)


@pytest.mark.long
def test_the_pads_slide_over_the_joint_and_hold():
    run = proved(ffsm_mj.run("handrail"))
    assert [phase.name for phase in run.phases] == ["close", "touch", "brake", "grip", "retract"]
    # Both pads land flat in one instant: that and the end of their slide is all that happens to them. The joint is no event.
    assert {impact.event for impact in run.impacts} == {0}
    kinds = {
        kind: len(records) for kind, records in run.records.items() if kind.startswith(("contact", "impact")) and records
    }
    assert kinds == {"impacts": 8, "contact_beginnings": 2, "contact_sticks": 2}
    places = pads_on_bar(run)
    begins = int(np.searchsorted(run.time, run.records["contact_beginnings"][0].time_s))
    assert abs(places[begins, 0]) + PAD_M < JOINT_M < places[-1, 0] - PAD_M
    # The joint passes under the pads while they brake: no force feels it. Where the slide has stopped, they turn on the bar
    # and share friction by how they turn; the load along the normal is that of the fingers all the same.
    brakes = (run.time > run.phases[2].start_s + 0.01) & (run.time < run.phases[3].start_s - 0.01)
    slides = brakes & (run.time < 3.0)
    assert places[slides][0, 0] - PAD_M < JOINT_M < places[slides][-1, 0] - PAD_M
    for pad in ("left", "right"):
        force, friction = run[f"contact.{pad}_force_N"], run[f"contact.{pad}_friction_N"]
        assert set(run[f"contact.{pad}_points"][brakes]) == {4.0}
        assert np.sqrt(force**2 - friction**2)[brakes] == pytest.approx(PRESS_N, abs=1e-9)
        # Turns of 2 mrad/s at 13 mm, beside a slide of 5 mm/s at its end.
        assert friction[slides] == pytest.approx(MU * PRESS_N, rel=2e-3)
    held = run.time > run.records["contact_sticks"][0].time_s
    assert np.ptp(places[held], axis=0).max() < 1e-9
    assert run["contact.left_friction_use"][-1] < 0.5
