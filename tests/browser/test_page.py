"""``ffsm export --html`` in a real browser: something is drawn, the slider moves it, nothing is asked of anybody."""

from __future__ import annotations

import html
from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.report.page import write_page
from tests.changed_logs import with_records
from tests.scenes import HEAD, scene

EVIL = "<script>window.hit = 1</script>"
ROBOT = f"""<mujoco>{HEAD}<asset><mesh name="wedge" vertex="0 0 0 .2 0 0 0 .2 0 0 0 .2"/></asset><worldbody>
  <body name="ball">
  <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/><joint name="x" type="slide" axis="1 0 0"/>
  <geom name="ball" size=".1" mass="0"/> <geom type="box" size=".1 .1 .1" pos="0 .5 0" mass="0"/>
  <geom type="capsule" size=".1 .1" pos="0 1 0" mass="0"/> <geom type="cylinder" size=".1 .1" pos="0 -.5 0" mass="0"/>
  <geom type="ellipsoid" size=".1 .2 .1" pos="0 -1 0" mass="0"/> <geom type="mesh" mesh="wedge" pos="0 0 .5" mass="0"/>
  </body></worldbody></mujoco>"""
TARGET = f"""<mujoco>{HEAD}<worldbody><body name="target"><inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/>
  <joint name="x" type="slide" axis="1 0 0"/><geom name="{html.escape(EVIL)}" size=".1" mass="0"/></body></worldbody>
  </mujoco>"""
FLOOR = f"""<mujoco>{HEAD}<worldbody><body name="floor"><geom name="floor" type="plane" size="1 1 1" pos="0 0 -.6"/></body>
  </worldbody></mujoco>"""
HIT_S = 0.3


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A run of shapes of every kind: one ball hits another after 0.3 s."""
    folder = tmp_path_factory.mktemp("page")
    path = scene(
        folder,
        ROBOT,
        {"target": TARGET, "floor": FLOOR},
        fixed={"floor": {}},
        duration_s=0.6,
        initial={"joints": {"target/x": 0.5}, "rates": {"robot/x": 1.0}},
        contacts={"rules": [{"between": ["ball", f"target/{EVIL}"]}]},
    )
    run = ffsm_mj.run(path)
    assert [round(hit.time_s, 9) for hit in run.impacts] == [HIT_S]
    phase = replace(run.phases[0], name=f"</script>{EVIL}")  # scenarios may not, logs may
    header = replace(run.log.header, scenario_name=EVIL)
    named = Run(with_records(replace(run.log, header=header), {"phases": (phase,)}))
    with pytest.MonkeyPatch.context() as patch:  # figures cost most of the time
        patch.setattr("ffsm_mj.report.page.document._FIGURES", {"energies": "Energies", "conservation": "Residuals"})
        write_page(named, folder / "run.html")
    return folder / "run.html"


def test_a_page_shows_the_run(browser, page):
    browser.open(page)
    assert browser.run("return window.atLoad") == ""  # drawn by then: chromium --screenshot takes its picture at "load"
    assert abs(browser.shown_s - HIT_S) < 1e-9  # begins at the first impact
    assert browser.part("now").text.startswith("0.300 s")
    hit = browser.picture()
    assert len(np.unique(hit.reshape(-1, 3), axis=0)) > 100  # shaded bodies on a ground
    assert (np.ptp(hit, axis=2) > 60).mean() > 0.005  # in colour: nothing in the models says which
    browser.slide(0.0)
    start = browser.picture()
    browser.slide(0.6)
    end = browser.picture()
    browser.slide(0.0)
    np.testing.assert_array_equal(browser.picture(), start)  # the same time, the same picture
    changed = (np.abs(end - start).max(axis=2) > 30).mean()
    assert 0.003 < changed < 0.5  # the bodies have moved on, the ground has not
    browser.slide(HIT_S)
    np.testing.assert_array_equal(browser.picture(), hit)
    assert browser.run("return document.querySelector('#scene .mark').checkVisibility()")  # the impulse beside its arrow
    browser.slide(0.1)
    assert not browser.run("return document.querySelector('#scene .mark').checkVisibility()")
    assert browser.faults() == []
    assert browser.requests() == [page.as_uri()]


def test_the_scene_is_in_the_middle_of_a_page(browser, page):
    """What is drawn at the first impact leaves the same room at both sides, and above and below, of all but a tenth."""
    browser.open(page)
    drawn = np.abs(browser.picture() - browser.picture()[5, 5]).max(axis=2) > 12
    for axis in (0, 1):
        where = np.flatnonzero(drawn.any(axis=axis))
        assert abs(where[0] + where[-1] - drawn.shape[1 - axis]) < 0.2 * drawn.shape[1 - axis]


def test_a_page_fits_a_phone(browser, page):
    """At 390 pixels nothing is wider than the page; what cannot be read so small is scrolled in place."""
    with browser.narrowed(390):
        browser.open(page)
        assert browser.run("return document.documentElement.scrollWidth") == 390
        wide = "document.querySelector('figure svg').getBoundingClientRect().width"
        assert browser.run(f"return {wide}") >= 560
        assert browser.run("return document.querySelector('figure').getBoundingClientRect().right") < 390


@pytest.mark.long
def test_names_are_text(browser, page):
    browser.open(page, dark=True)
    assert browser.run("return window.hit") is None
    assert browser.run("return document.querySelector('h1').textContent") == EVIL
    assert browser.part("now").text.endswith(f"</script>{EVIL}")
    assert f"target/{EVIL}" in browser.run("return document.querySelector('#results table').textContent")
    assert (
        browser.run("return document.querySelectorAll('script').length") == 5
    )  # data, library, snapshot, own, the viewer's
    dark = browser.picture()
    assert dark[5, 5].max() < 60
    browser.run("document.getElementById('speed').value = '0.1'")
    browser.click("play")
    assert browser.part("play").get_attribute("aria-label") == "Pause"
    browser.run("document.getElementById('speed').value = '4'")
    browser._until_shown(0.6)  # it plays up to its end
    assert browser.part("play").get_attribute("aria-label") == "Play"
    assert browser.faults() == []


@pytest.mark.long
def test_a_line_in_every_plot_is_at_the_time_shown(browser, page):
    browser.open(page)
    browser.slide(0.45)
    lines = browser.run(
        "return [...document.querySelectorAll('figure svg line.cursor')].map((line) => "
        "[line.x1.baseVal.value, line.dataset.left, line.dataset.right, line.dataset.start, line.dataset.end].map(Number))"
    )
    assert len(lines) >= 4
    for x, left, right, start, end in lines:
        assert abs(x - (left + (right - left) * (0.45 - start) / (end - start))) < 1e-3
        assert (start, end) == pytest.approx((0.0, 0.6), abs=1e-12)
