"""Layout of a recording: it opens at the first event with everything in view; legends and texts have room."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb

from ffsm_mj.contact_models.persistent.record import ContactBegins
from ffsm_mj.log.drawing import shapes
from ffsm_mj.log.markers import MarkSequence, texts
from ffsm_mj.log.rerun.layout import Contents, Framing, Opening, blueprint
from ffsm_mj.log.rerun.plots import Extent, Plot, phase_looks
from ffsm_mj.log.rerun.scene import Marks
from ffsm_mj.log.rerun.sink import write_recording
from ffsm_mj.records.events import ImpactRecord
from tests.log.test_recording import read
from tests.scenes import ball, compile_paths, scene, two_balls

TASK = {"tip": "tip", "axes": ["x", "y"], "target_m": [1.0, 0.0]}


@pytest.fixture
def layout(monkeypatch, tmp_path):
    """Function that makes the recording of a run and returns its layout."""
    sent: list[rrb.Blueprint] = []
    monkeypatch.setattr(rr.RecordingStream, "send_blueprint", lambda _, layout: sent.append(layout))

    def made(run):
        write_recording(run.log, tmp_path / "run.rrd")
        (layout,) = sent
        return layout

    return made


def views(container):
    """Views in a container, row by row."""
    for part in container.contents:
        yield from views(part) if isinstance(part, rrb.Container) else [part]


def ends(view):
    """Time range of a view, s."""
    (axis,) = [part for name, part in view.properties.items() if name == "TimeAxis"]
    (span,) = axis.view_range.as_arrow_array().to_pylist()
    return span["start"] * 1e-9, span["end"] * 1e-9


def test_a_recording_opens_at_the_first_impact(layout, tmp_path, ffsm_run):
    """Balls 0.3 m apart at 1 m/s meet at 0.3 s; the loop ends 2 s later, and is less than half of 5 s."""
    opened = layout(ffsm_run(two_balls(tmp_path, duration_s=5.0)))
    panel = opened.time_panel
    assert (panel.play_state, panel.loop_mode, panel.timeline) == ("playing", "selection", "sim_time")
    assert panel.time_selection.min.value == 0
    assert panel.time_selection.max.value == pytest.approx(2.3e9, abs=1e3)
    tabs = opened.root_container.contents[1].contents[:2]
    assert [tab.name for tab in tabs] == ["Overview", "Close-up of the events"]
    story, close = (next(views(tab)) for tab in tabs)
    assert story.name == close.name == "Kinetic energy [J]"
    assert -0.5 < ends(story)[0] < 0.0
    assert -0.5 < ends(close)[0] < 0.0
    # A legend of "objects" is 79 of 290 pixels wide, and stands behind the curves' end.
    for view, end_s in ((story, 5.0), (close, 2.3)):
        start_s, shown_s = ends(view)
        assert (shown_s - end_s) / (shown_s - start_s) > 0.27


def test_without_events_a_recording_plays_from_its_start(layout, tmp_path, ffsm_run):
    opened = layout(ffsm_run(two_balls(tmp_path, duration_s=0.1)))
    assert opened.time_panel.time_selection is opened.time_panel.loop_mode is None
    assert "Close-up of the events" not in [tab.name for tab in opened.root_container.contents[1].contents]


def laid_out(points, *, forces=(), efforts=()):
    """Contents with some plots of efforts and their values."""
    plots = [Plot(f"plots/{name}", [0], ["total"], [(0, 0, 0)]) for name in ("energy", "balance")]
    extents = {plot.entity: Extent() for plot, _ in efforts}
    for plot, values in efforts:
        extents[plot.entity].add(plot, values)
    plots += [plot for plot, _ in efforts]
    return Contents(framing=Framing(points), plots=plots, trails=[], tip=True, forces=forces, extents=extents)


@pytest.mark.parametrize("forces", [(), ("a_b",)])
def test_plots_fill_all_cells_of_the_layout(forces):
    """Rows of two views; a single last view is as wide as two."""
    story = blueprint(laid_out(np.eye(3), forces=forces), None).root_container.contents[1].contents[0]
    rows = [row.contents if isinstance(row, rrb.Horizontal) else [row] for row in story.contents]
    assert [len(row) for row in rows] == ([2, 2] if forces else [2, 1])


def test_all_points_are_in_the_view_of_the_camera(rng):
    """Within the tangents 0.55 and 0.42 of half the field of view, from no farther than necessary."""
    for _ in range(20):
        points = rng.uniform(-5.0, 5.0, size=3) + rng.uniform(-1.0, 1.0, size=(30, 3)) * rng.uniform(0.2, 4.0, size=3)
        scene_view = blueprint(laid_out(points), None).root_container.contents[0].contents[0]
        eye = scene_view.properties["EyeControls3D"]
        place, target = (np.array(part.as_arrow_array().to_pylist()[0]) for part in (eye.position, eye.look_target))
        ahead = (target - place) / np.linalg.norm(target - place)
        across = np.cross(ahead, [0.0, 0.0, 1.0])
        across /= np.linalg.norm(across)
        rest = points - place
        depth = rest @ ahead
        assert (depth > 0.0).all()
        wide, high = np.abs(rest @ across / depth).max() / 0.55, np.abs(rest @ np.cross(across, ahead) / depth).max() / 0.42
        assert 0.8 < max(wide, high) < 1.05


def test_phases_bear_their_whole_names():
    looks = phase_looks(["approach", "safety_pause", "approach"])
    assert looks.labels.as_arrow_array().to_pylist() == ["approach", "safety pause"]


def test_all_plots_of_a_recording_have_one_time_axis(layout, baseline):
    """Those of all tabs, except the close-up, whose plots have another one; the lanes of states show the whole run too."""
    parts = layout(baseline).root_container.contents
    overview, close, *others = parts[1].contents
    whole = {ends(view) for tab in (overview, *others) for view in views(tab)}
    assert len(whole) == len(set(map(ends, views(close)))) == 1
    ((start_s, end_s),) = whole
    assert -1.0 < start_s < 0.0
    assert end_s > 30.0
    (lanes,) = [view for view in parts[0].contents if isinstance(view, rrb.StateTimelineView)]
    assert ends(lanes) == pytest.approx((-0.6, 31.2), abs=1e-9)  # 2 % before and 4 % after it


def test_bounds_do_not_drive_the_range_of_a_plot(rng):
    """A torque of 0.2 N m within bounds of 40 N m: the plot is 8 % higher and lower than the range of the torque.

    Its title has the bounds; the plot of one that reaches them shows them.
    """
    for greatest, title in ((0.2, "m [N m], bounds 40 or more"), (40.0, "m [N m] and its bounds")):
        torque = rng.uniform(-greatest, greatest, size=50)
        torque[:2] = -greatest, greatest
        plot = Plot("plots/joints/m", [0, 1, 2], ["lower bound", "upper bound", "m"], [(0, 0, 0)] * 3, "N m", limits=(0, 1))
        contents = laid_out(np.eye(3), efforts=[(plot, np.column_stack((np.full(50, -40.0), np.full(50, 40.0), torque)))])
        (view,) = blueprint(contents, None).root_container.contents[1].contents[1].contents
        assert view.name == title
        shown = view.properties["ScalarAxis"].range.as_arrow_array().to_pylist()[0]
        np.testing.assert_allclose(shown, [-1.16 * greatest, 1.16 * greatest], rtol=1e-12)


@pytest.mark.parametrize(("torque", "is_shown"), [(0.0, False), (np.nan, False), (1e-9, True)])
def test_empty_plots_are_left_out(torque, is_shown):
    """Of an actuator that never acted, and of what has no values: not those of the smallest effort."""
    plot = Plot("plots/joints/m", [0, 1, 2], ["lower bound", "upper bound", "m"], [(0, 0, 0)] * 3, "N m", limits=(0, 1))
    contents = laid_out(np.eye(3), efforts=[(plot, np.array([[-1.0, 1.0, 0.0], [-1.0, 1.0, torque]]))])
    tabs = [tab.name for tab in blueprint(contents, None).root_container.contents[1].contents]
    assert ("Joints" in tabs) == is_shown


def hit(time_s, impulse, x):
    values = dict.fromkeys(ImpactRecord.__dataclass_fields__, 0)
    values |= {"time_s": time_s, "pair": "a-b", "geoms": ("a", "b"), "impulse_N_s": impulse}
    vectors = {"point_m": (x, 0.0, 0.0), "normal": (1.0, 0.0, 0.0), "tangential_impulse_N_s": (0.0, 0.0, 0.0)}
    return ImpactRecord(**values | vectors)


def test_of_many_marks_at_one_place_only_the_greatest_has_a_text(tmp_path):
    """The greatest so far; marks elsewhere or much later have texts too."""
    path = two_balls(tmp_path)
    system = compile_paths(path.parent / "robot.xml", {"target": path.parent / "target.xml"})
    shown: dict[str, str] = {}

    def send(_, entity, columns):
        for column in columns:
            if column.component_descriptor().component.endswith(":labels"):
                shown[entity] = column.as_arrow_array().to_pylist()[0][0]
            elif "Clear" in column.component_descriptor().component:
                shown[entity] = ""

    marks = Marks(send, Opening(system), 1.0)
    for time_s, impulse, x in ((1.0, 2.0, 0.0), (1.1, 0.5, 0.01), (1.2, 3.0, 0.02), (1.3, 0.5, 2.0), (4.0, 0.5, 0.0)):
        marks.event(hit(time_s, impulse, x))
    marks.label()
    assert list(shown.values()) == ["", "3 N s", "0.5 N s", "0.5 N s"]  # the second of five has never had one


def test_texts_of_an_instant_that_would_overlap_are_one():
    """Whatever the order: of each kind the greatest, the greatest of all first; elsewhere another text."""
    begins = dict.fromkeys(ContactBegins.__dataclass_fields__, 0) | {"time_s": 1.0, "pair": "a-b", "force_after_N": 2.5}
    begins = ContactBegins(**begins | {"point_m": (0.02, 0.0, 0.0), "normal": (1.0, 0.0, 0.0)})
    records = [hit(1.0, 0.5, 0.0), hit(1.0, 3.0, 0.01), begins, hit(1.0, 0.25, 9.0)]
    for order in itertools.permutations(records):
        marks = [mark for record in order for mark in MarkSequence(1.0).add(record)]
        found = [(drawn.mark.point_m[0], lines) for drawn, lines in texts(marks, 1.0)]
        assert found == [(0.01, ["3 N s", "2.5 N"]), (9.0, ["0.25 N s"])]


def test_the_path_of_the_tip_changes_its_colour_at_the_impact(tmp_path, ffsm_run):
    """At 0.3 s; that of the base does not change."""
    robot = ball("ball", mass=2.0, joints="x", extra='<site name="tip" pos="0.1 0 0"/>')
    path = scene(
        tmp_path,
        robot,
        {"target": ball("target", mass=3.0, joints="x")},
        initial={"joints": {"target/x": 0.5}, "rates": {"robot/x": 1.0}},
        contacts={"rules": [{"between": ["ball", "target/target"], "restitution": 1.0}]},
        task=TASK,
        duration_s=0.6,
    )
    write_recording(ffsm_run(path).log, tmp_path / "run.rrd")
    data = read(tmp_path / "run.rrd")
    of_tip, of_base = (data[f"/world/trails/{name}", "Points3D:colors"] for name in ("tip", "robot"))
    before, after = ({value[0] for t, value in of_tip if (t < 0.3 - 1e-9) == early} for early in (True, False))
    assert len(before) == len(after) == 1
    assert before != after
    assert len({value[0] for _, value in of_base}) == 1


def test_bodies_without_colours_get_different_ones(tmp_path):
    path = two_balls(tmp_path)
    system = compile_paths(path.parent / "robot.xml", {"target": path.parent / "target.xml"})
    one, other = (np.array(shape.rgba[:3]) for shape in shapes(system))
    assert np.linalg.norm(one - other) > 0.3
