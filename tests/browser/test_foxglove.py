"""An independent reader draws ``run.mcap``: Foxglove's packages for files and schemas, and three.js, in a real browser.

Foxglove and Lichtblick are programs that no package registry has. ``make reader`` builds what stands in for them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ffsm_mj
from tests.scenes import two_balls

READER = Path(__file__).parent / "reader"
HIT_S = 0.3


@pytest.fixture(scope="module")
def reader(browser):
    if not (READER / "node_modules/.built/reader.js").is_file():
        pytest.skip("THE READER IS NOT BUILT, FOXGLOVE'S TOPICS ARE NOT DRAWN: make reader (needs npm)")
    browser.open(READER / "reader.html")
    return browser


def test_an_independent_reader_draws_the_scene(reader, tmp_path):
    """Bodies, arrow and text of the impact, outlines; what the published schemas say is what those in the file say."""
    run = ffsm_mj.run(two_balls(tmp_path, duration_s=0.6), out=tmp_path / "run", rerun=False)
    told = reader.read(run.path)
    assert (told["differing"], told["mistimed"]) == ([], [])  # stamps are the times of the log
    assert {name: schema for name, (schema, number) in told["topics"].items() if number} == {
        "/tf": "foxglove.FrameTransforms",
        "/scene": "foxglove.SceneUpdate",
        "/scene/impacts": "foxglove.SceneUpdate",
        "/log": "foxglove.Log",
        "/outline/robot/ball": "foxglove.PointCloud",
        "/outline/target/target": "foxglove.PointCloud",
    }
    assert told["topics"]["/tf"][1] == 31  # 50 Hz
    (_, _, begun), (at, level, hit), *_ = reader.run("return log()")
    assert "phase coast" in begun
    assert (abs(at - HIT_S) < 1e-9, level) == (True, "INFO")
    assert hit.startswith("impact ball-target/target: impulse ")
    start = draw(reader, 0.0)
    assert reader.counts["spheres"] == 2
    assert reader.counts["points"] > 100
    assert reader.counts["texts"] == []
    struck = draw(reader, HIT_S + 1e-6)
    assert (reader.counts["arrows"], reader.counts["texts"]) == (1, [run.log.marks()[0][2].text])
    yellow = (struck[:, :, 0] > 150) & (struck[:, :, 1] > 140) & (struck[:, :, 2] < 110)
    assert yellow.mean() > 1e-4  # the arrow, about as long as the ball: 100 pixels of 800 x 480
    assert (np.abs(struck - start).max(axis=2) > 30).mean() > 2e-3
    np.testing.assert_array_equal(draw(reader, 0.0), start)
    assert reader.faults() == []


def draw(reader, seconds):
    """The picture at a time."""
    reader.counts = reader.run("return draw(arguments[0])", seconds)
    return reader.picture()
