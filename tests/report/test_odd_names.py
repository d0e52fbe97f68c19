"""Names that look like mathematics to Matplotlib are drawn literally."""

from __future__ import annotations

from html import escape
from io import StringIO

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure

from ffsm_mj.report.plots.panels import Curve, Panel, stacked
from ffsm_mj.report.plots.style import plain, publication


@pytest.mark.parametrize("name", ["$script ${script} $$", "$x$", "a$b", "$", r"$\frac$", "a_b"])
def test_a_name_is_drawn_literally(name):
    with publication():
        mpl.rcParams["svg.fonttype"] = "none"
        figure, held = Figure(), StringIO()
        figure.text(0.5, 0.5, plain(name))
        figure.savefig(held, format="svg")
    assert f">{escape(name)}</text>" in held.getvalue()


def test_control_characters_of_a_name_are_escaped():
    assert plain("\x1b[2J\u202e\na") == r"\x1b[2J\u202e\na"


def test_values_beyond_every_axis_are_gaps(two_phases):
    values = two_phases.time * 0.0
    values[1:4] = 1e308, float("inf"), float("nan")
    figure = stacked(two_phases, [Panel("x, m", [Curve("x", values)])])
    (line,) = (line for line in figure.axes[0].lines if len(line.get_xdata()) == len(values))
    assert list(line.get_ydata()).count(0.0) == len(values) - 3
    assert all(abs(edge) < 1e3 for edge in figure.axes[0].get_ylim())


@pytest.fixture
def two_phases(tmp_path):
    """A short run with odd names of phases."""
    import ffsm_mj
    from tests.scenes import two_balls

    phases = [{"name": "$a$ $$", "for_s": 0.004, "controller": {"kind": "off"}}]
    phases.append({"name": "${b}", "until": "end", "controller": {"kind": "off"}})
    return ffsm_mj.run(two_balls(tmp_path, duration_s=0.01, phases=phases), out=tmp_path / "out", rerun=False)


def test_phases_of_such_names(two_phases):
    with publication():
        stacked(two_phases, [Panel("x, m", [Curve("x", two_phases.time)])]).savefig(StringIO(), format="svg")
