"""Representation of a run in a terminal and in a notebook."""

from __future__ import annotations

import base64
import io
import re
import subprocess
import sys
import time
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

import ffsm_mj
from ffsm_mj.analysis import run as run_module
from ffsm_mj.errors import InputError
from tests.changed_logs import with_records
from tests.scenes import ball, scene, two_balls


@pytest.fixture(scope="module")
def hit(tmp_path_factory, ffsm_run):
    """Two balls, e = 1, in contact at 0.3 s; the impulse is 2 * 2 * 3 / 5 N s."""
    return ffsm_run(two_balls(tmp_path_factory.mktemp("hit"), duration_s=0.5))


def pictures(html, kind):
    """Decoded images of a cell."""
    found = re.findall(rf'<img [^>]*src="data:image/{kind};base64,([^"]+)"', html)
    return [Image.open(io.BytesIO(base64.b64decode(text))) for text in found]


class Tags(HTMLParser):
    """Parser for the element names and the text of a page."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)

    def handle_data(self, data):
        self.text += data


def test_the_representation_of_a_run_shows_its_results(hit):
    said = repr(hit)
    assert said.startswith("<Run scene: completed after 0.5 s; 1 impact; all 13 checks of rows and records pass; worst: ")
    assert len(said.splitlines()) == 1
    page = Tags(hit._repr_html_())
    assert "completed after 0.5 s" in page.text
    assert "0.300000 s: robot/ball on target/target, 2.4 N s" in page.text


def test_the_representation_shows_the_tip(baseline):
    tip = baseline.summary()["tip"]
    second = repr(baseline).splitlines()[1]
    assert second == (
        f"  tip final error {tip['final_error_m']:.4g} m, "
        f"smallest {tip['min_error_m']:.4g} m at {tip['min_error_time_s']:.3f} s>"
    )
    assert second.strip().removeprefix("tip ").removesuffix(">") in Tags(baseline._repr_html_()).text


def test_the_representation_shows_a_failed_check(hit):
    """A log with an energy change of the impact that is 1e-3 J too large."""
    record = hit.impacts[0]
    wrong = replace(record, energy_change_J=record.energy_change_J + 1e-3)
    run = ffsm_mj.Run(with_records(hit.log, {"impacts": (wrong,)}))
    assert "1 of 13 checks of rows and records FAILED; worst: impact energy of total, 1.0e-03 J of " in repr(run)


def test_a_residual_that_is_not_finite_is_the_worst(hit):
    rows = np.array(hit.log.rows)
    rows[300, hit.keys.index("energy.total_J")] = np.nan
    assert "FAILED; worst: energy of total, nan J of" in repr(ffsm_mj.Run(replace(hit.log, rows=rows)))


def test_the_representation_of_an_incomplete_run(hit):
    run = ffsm_mj.Run(replace(hit.log, outcome=None, damage="7 bytes cannot be read"))
    assert "scene: damaged: 7 bytes cannot be read; incomplete: the log breaks off before the end of the run;" in repr(run)


def test_names_and_messages_are_escaped(tmp_path):
    """Markup in names of a hostile log stays text, on one line."""
    evil = "<script>alert(1)</script>"
    path = scene(
        tmp_path,
        ball("ball", mass=2.0, joints="x").replace('geom name="ball"', 'geom name="&lt;script&gt;alert(1)"'),
        {"target": ball("target", mass=3.0, joints="x")},
        initial={"joints": {"target/x": 0.5}, "rates": {"robot/x": 1.0}},
        contacts={"rules": [{"between": ["robot/<script>alert(1)", "target/target"]}]},
        duration_s=0.4,
    )
    run = ffsm_mj.run(path)
    header = replace(run.log.header, scenario_name=f"a\n{evil}")
    log = replace(run.log, header=header, outcome=replace(run.log.outcome, message=f"\x1b[31m{evil}"))
    page = ffsm_mj.Run(log)._repr_html_()
    assert set(Tags(page).tags) <= {"table", "caption", "tr", "th", "td", "br"}
    assert Tags(page).text.count("<script>") == 3
    assert "\x1b" not in page
    assert len(repr(ffsm_mj.Run(log)).splitlines()) == 1


def test_the_representation_does_not_read_a_long_log(hit, monkeypatch):
    """Rows above the limit are not read; results accumulated during the run are shown at any length."""
    monkeypatch.setattr(run_module, "KEPT_BYTES", 8 * len(hit.keys) * 500)  # hit has 501 rows
    fresh, known = ffsm_mj.load_run(hit.path), hit.digest
    monkeypatch.setattr(type(fresh.log), "blocks", lambda _: pytest.fail("the rows are read"))
    assert "1 impact; checks not evaluated yet: checks() reads the whole log>" in repr(fresh)
    assert "checks not evaluated yet" in fresh._repr_html_()
    told = ffsm_mj.Run(fresh.log, fresh.path, known)
    assert "all 13 checks of rows and records pass" in repr(told)


def test_the_representation_uses_the_digest(baseline):
    """With a known digest, no pass over the rows is needed."""
    assert baseline.digest.samples == 30001
    began = time.perf_counter()
    for _ in range(20):
        repr(baseline), baseline._repr_html_()
    assert (time.perf_counter() - began) / 20 < 0.02


def test_out_sets_the_path(tmp_path):
    """The returned run has the path of its log, as found by ``load_run``."""
    scenario = two_balls(tmp_path, duration_s=0.1)
    run = ffsm_mj.run(scenario, out=tmp_path / "mine", rerun=False)
    assert run.path == tmp_path / "mine" / "run.mcap" == ffsm_mj.load_run(tmp_path / "mine").path
    assert run.path.is_file()
    assert ffsm_mj.run(scenario).path is None
    assert isinstance(run, ffsm_mj.Run)
    assert isinstance(ffsm_mj.load_run(run.path), ffsm_mj.Run)


def test_a_run_is_read_from_another_folder(tmp_path, monkeypatch):
    """After a change of the folder (``%cd``), a run in a relative folder is still readable."""
    monkeypatch.chdir(tmp_path)
    run = ffsm_mj.run(two_balls(tmp_path, duration_s=0.1), out="mine", rerun=False)
    read = ffsm_mj.load_run("mine")
    monkeypatch.chdir("/")
    assert run.path == read.path == tmp_path / "mine" / "run.mcap"
    np.testing.assert_array_equal(run["state.q_robot_x_m"], read["state.q_robot_x_m"])
    assert len(run.time) == 101


def test_plot_displays_figures_in_a_cell(hit):
    """Those of ``--plots`` as PNG; pyplot is not imported."""
    figures = ffsm_mj.plot(hit, "motion", "energies")
    assert list(figures) == ["motion", "energies"]
    assert repr(figures) == "<Figures motion, energies>"
    drawn = pictures(figures._repr_html_(), "png")
    assert [picture.width > 300 for picture in drawn] == [True, True]
    assert all(np.asarray(picture.convert("L")).std() > 5 for picture in drawn)  # not an empty sheet
    assert figures["energies"].axes
    with pytest.raises(KeyError, match=r"unknown figure 'tip'; allowed: energies, motion"):
        figures["tip"]
    with pytest.raises(KeyError, match=r"unknown figure 'energy' \(did you mean 'energies'\?\); allowed: base, "):
        ffsm_mj.plot(hit, "energy")


def test_plot_without_names_has_every_figure(hit):
    assert set(ffsm_mj.plot(hit)) == {"motion", "base", "torques", "momenta", "energies", "conservation"}


def test_animate_displays_an_animation_in_a_cell(hit, tmp_path):
    """0.5 s at 10 frames per second are 6 frames, in the cell and in the saved file."""
    film = ffsm_mj.animate(hit, frames_per_second=10.0)
    assert repr(film) == "Film(name='scene', description='6 frames, 0.6 s in real time')"
    (shown,) = pictures(film._repr_html_(), "gif")
    assert shown.n_frames == 6
    with Image.open(film.save(tmp_path / "new" / "x.gif")) as saved:
        assert saved.n_frames == 6
    with pytest.raises(InputError, match=r"x\.mp4: must end in \.gif; for \.mp4 use 'ffsm export --mp4'"):
        film.save(tmp_path / "x.mp4")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"frames_per_second": 0.0}, r"frames_per_second is 0\.0; allowed: above 0, up to 50"),
        ({"frames_per_second": 51}, "frames_per_second is 51; allowed"),
        ({"speed": -1.0}, r"speed is -1\.0; allowed: a positive number"),
        ({"speed": float("nan")}, "speed is nan; allowed: a positive number"),
        ({"speed": 1e-3, "frames_per_second": 50.0}, "more than 6000; raise speed or lower frames_per_second"),
    ],
)
def test_an_impossible_animation_is_refused(hit, options, said):
    with pytest.raises((ValueError, InputError), match=said):
        ffsm_mj.animate(hit, **options)


def test_the_name_of_an_animation_is_escaped(hit):
    film = replace(ffsm_mj.animate(hit, frames_per_second=2.0), name='"><script>alert(1)</script>')
    assert Tags(film._repr_html_()).tags == ["img"]


def python(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


@pytest.mark.long
def test_matplotlib_is_imported_on_demand(tmp_path):
    lines = python(f"""
import sys, ffsm_mj
run = ffsm_mj.run({str(two_balls(tmp_path, duration_s=0.1))!r})
repr(run), run._repr_html_()
drawing = {{"matplotlib", "PIL", "rerun"}}
print(sorted(drawing & set(sys.modules)))
ffsm_mj.plot(run, "energies")._repr_html_()
print("matplotlib" in sys.modules, "matplotlib.pyplot" in sys.modules)
""")
    assert lines == ["[]", "True False"]


def test_ipython_completes_the_columns(hit):
    assert hit._ipython_key_completions_() == list(hit.keys)
