"""Fixed bodies in viewers: their shapes in a frame at their pose from the start."""

from __future__ import annotations

import numpy as np
import pytest

import ffsm_mj
from tests.log.test_recording import entities, read
from tests.log.test_viewer_topics import decoded
from tests.scenes import HEAD, ball, scene

PLACE, TURN = (1.0, 0.2, -0.3), (0.8, 0.0, 0.0, 0.6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Run folder of a ball that hits a wall with a second body."""
    wall = f"""<mujoco>{HEAD}<worldbody><geom name="plate" type="box" size="0.1 1 1"/>
      <body name="knob" pos="0 0 0.5"><geom name="knob" size="0.05"/></body></worldbody></mujoco>"""
    path = scene(
        tmp_path_factory.mktemp("wall"),
        ball("ball", joints="x"),
        {"wall": wall},
        fixed={"wall": {"position_m": PLACE, "quaternion": TURN}},
        initial={"rates": {"robot/x": 2.0}},
        contacts={"rules": [{"between": ["ball", "wall/plate"]}]},
        duration_s=0.5,
    )
    run = ffsm_mj.run(path, out=path.parent / "out", rerun=True)
    assert len(run.impacts) == 1
    return path.parent / "out"


def test_foxglove_has_frames_and_shapes_of_a_fixed_body(folder):
    topics = decoded(folder / "run.mcap")
    for _, message in topics["/tf"]:
        poses = {each.child_frame_id: (each.translation, each.rotation) for each in message.transforms}
        assert set(poses) == {"robot/ball", "wall/world", "wall/knob"}
        place, turn = poses["wall/world"]
        assert (place.x, place.y, place.z) == PLACE
        assert (turn.w, turn.x, turn.y, turn.z) == pytest.approx(TURN, abs=1e-15)
        knob, _ = poses["wall/knob"]
        assert (knob.x, knob.y, knob.z) == pytest.approx((1.0, 0.2, 0.2), abs=1e-15)
    ((_, update),) = topics["/scene"]
    (cube,) = next(entity for entity in update.entities if entity.id == "wall/world").cubes
    assert cube.size.y == 2.0
    assert len(topics["/outline/wall/world"]) == 1


def test_rerun_has_shapes_of_a_fixed_body_at_its_pose(folder):
    recording = folder / "run.rrd"
    text = entities(recording)
    for entity in ("/world/wall/world/plate", "/world/wall/knob/knob", "/world/trails/robot"):
        assert entity in text
    assert "/world/trails/wall" not in text  # it goes nowhere
    places = {entity: rows for (entity, what), rows in read(recording).items() if "translation" in what}
    assert places["/world/wall/world"][0][0] == 0.0
    for _, place in places["/world/wall/world"]:
        np.testing.assert_allclose(np.ravel(place), PLACE, atol=1e-6)  # Rerun keeps single precision
