"""A target that moves, in viewers: at each of their frames where the log has it; one that stands still, once."""

from __future__ import annotations

import numpy as np

import ffsm_mj
from ffsm_mj.log.foxglove import SCENE_TOPIC, TARGET_TOPIC
from tests.log.test_recording import read
from tests.log.test_viewer_topics import decoded

TRAJECTORY = {"waypoints": [{"at_s": 0.15, "position_m": [3.0, 2.0]}]}


def crosses(messages):
    """Time and place of each drawn target."""
    for time, update in messages:
        for entity in update.entities:
            if entity.id == "target":
                place = entity.cubes[0].pose.position
                yield time * 1e-9, (place.x, place.y, place.z)


def test_it_is_drawn_where_it_is(tmp_path):
    run = ffsm_mj.run("baseline", {"duration_s": 0.2, "task.trajectory": TRAJECTORY}, out=tmp_path / "out", rerun=True)
    path = np.column_stack([run[f"state.target_{axis}_m"] for axis in "xyz"])
    messages = decoded(tmp_path / "out" / "run.mcap")
    times, places = (np.array(each) for each in zip(*crosses(messages[TARGET_TOPIC]), strict=True))
    rows = np.searchsorted(run.time, times - 1e-9)
    assert len(rows) > 5
    assert np.array_equal(places, path[rows])
    assert np.ptp(places, axis=0)[1] == np.ptp(path, axis=0)[1] > 1.9  # it has come whole
    assert not list(crosses(messages[SCENE_TOPIC]))
    translations = read(tmp_path / "out" / "run.rrd")["/world/task/target", "Transform3D:translation"]
    assert np.allclose([place[0] for _, place in translations], path[rows], rtol=1e-6)  # single precision


def test_one_that_stands_still_is_drawn_once(tmp_path):
    ffsm_mj.run("baseline", {"duration_s": 0.2}, out=tmp_path / "out")
    messages = decoded(tmp_path / "out" / "run.mcap")
    assert len(list(crosses(messages[SCENE_TOPIC]))) == 1
    assert TARGET_TOPIC not in messages
