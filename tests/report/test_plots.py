"""Figures: outlines against closed forms, labels on all axes, equal bytes for equal data."""

from __future__ import annotations

import re
from io import BytesIO

import mujoco
import numpy as np
import pytest
from PIL import Image

from ffsm_mj._core.polygons import hull
from ffsm_mj.report import pictures, plots
from ffsm_mj.report.animation import animate
from ffsm_mj.report.plots.motion import view_box
from ffsm_mj.report.plots.panels import Curve, Panel, envelope, running_maximum, stacked
from ffsm_mj.report.plots.silhouette import Plane, Silhouette
from ffsm_mj.report.plots.subject import Subject
from tests.scenes import HEAD, ball, scene, two_balls


@pytest.fixture(scope="module")
def hit(tmp_path_factory, ffsm_run):
    return ffsm_run(two_balls(tmp_path_factory.mktemp("hit"), duration_s=0.5))


@pytest.fixture(scope="module")
def spatial(ffsm_run):
    """The spatial scenario through its first impact, at a coarse tick."""
    return ffsm_run("spatial", {"duration_s": 2.1})


def area(polygon):
    x, y = polygon.T
    return 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


SHAPES = {  # geom, area of its outline seen along z, after a turn of 0.7 rad about x
    "box": ('type="box" size="0.3 0.2 0.1"', 0.6 * (0.4 * np.cos(0.7) + 0.2 * np.sin(0.7))),
    "sphere": ('type="sphere" size="0.3"', np.pi * 0.09),
    "capsule": ('type="capsule" size="0.1 0.4"', np.pi * 0.01 + 0.2 * 0.8 * np.sin(0.7)),
    "cylinder": ('type="cylinder" size="0.1 0.4"', np.pi * 0.01 * np.cos(0.7) + 0.2 * 0.8 * np.sin(0.7)),
    "ellipsoid": ('type="ellipsoid" size="0.3 0.2 0.1"', np.pi * 0.3 * np.hypot(0.2 * np.cos(0.7), 0.1 * np.sin(0.7))),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_outlines_have_the_area_of_the_projection(shape, tmp_path, ffsm_run):
    """Circles are drawn with 48 corners, so their area is 0.3 % too small."""
    geom, expected = SHAPES[shape]
    robot = f"""<mujoco>{HEAD}<worldbody><body name="b"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom name="g" {geom} mass="0"/></body></worldbody></mujoco>"""
    turned = [0.5, -0.25, 0.0, np.cos(0.35), np.sin(0.35), 0.0, 0.0]
    path = scene(tmp_path, robot, {}, duration_s=0.002, initial={"joints": {"free": turned}})
    subject = Subject(ffsm_run(path))
    (outline,) = subject.silhouette.outlines(subject.run.qpos[0], Plane(0, 1))
    assert area(outline.points) == pytest.approx(expected, rel=4e-3)
    np.testing.assert_allclose(outline.points.mean(axis=0), [0.5, -0.25], atol=1e-9)


def test_nearer_geoms_are_drawn_later(case_study):
    """Seen along -z, the third link's tube (z = 0.88) is above the first's (0.56)."""
    silhouette = Silhouette(case_study)
    names = [case_study.mj.geom(g).name for g, _ in silhouette._geoms]
    outlines = silhouette.outlines(mujoco.MjData(case_study.mj).qpos, Plane(0, 1))
    assert len(outlines) == len(names)
    long = [i for i, shape in enumerate(outlines) if np.ptp(shape.points, axis=0).max() == pytest.approx(2.1, abs=0.03)]
    assert len(long) >= 3  # the three tubes (2 m and two caps), nearest last
    assert outlines[-1].tree == "robot"


def test_hull_of_a_square_with_points_inside(rng):
    inside = rng.uniform(0.01, 0.99, size=(50, 2))
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    np.testing.assert_array_equal(hull(np.vstack((inside, corners))), corners)


def test_thinned_curves_keep_their_peaks():
    time, values = np.linspace(0.0, 30.0, 30001), np.zeros(30001)
    values[[777, 20002]] = 50.0, -50.0
    x, y = envelope(time, values)
    assert len(x) < 6000
    assert (y.max(), y.min(), x[0], x[-1]) == (50.0, -50.0, 0.0, 30.0)
    middles, worst = running_maximum(time, values)
    assert worst.max() == 50.0
    assert middles[np.argmax(worst)] == pytest.approx(0.777, abs=0.075)


def test_figures_of_a_planar_hit_without_a_task(hit):
    figures = plots.figures(hit)
    assert list(figures) == ["motion", "base", "torques", "momenta", "energies", "conservation"]


def test_no_curve_crosses_the_label_of_the_marks(hit):
    """Momenta jump to their greatest values at the impact."""
    for name, figure in plots.figures(hit, ["base", "momenta", "energies", "conservation"]).items():
        figure.canvas.draw()
        axes = figure.axes[0]
        (word,) = (text.get_window_extent() for text in axes.texts if text.get_text() == "impact")
        for line in axes.get_lines():
            if line.get_label()[0] != "_":  # a curve, not the mark of the impact
                x, y = line.get_transform().transform(line.get_xydata()).T
                assert y[(x > word.x0) & (x < word.x1)].max(initial=0.0) < word.y0, (name, line.get_label())


def test_the_pose_of_the_impact_has_a_label_before_others_nearby(tmp_path, ffsm_run):
    """There is no room for a label of the end, 20 mm away."""
    motion = plots.figures(ffsm_run(two_balls(tmp_path, duration_s=0.32)), ["motion"])["motion"]
    assert "0.3 s" in [text.get_text() for text in motion.axes[0].texts]


def test_figures_in_space(spatial):
    """Two projections of the motion; all axes have labels, the bottom ones the time."""
    figures = plots.figures(spatial)
    assert {"joints", "tip", "torques", "momenta"} <= set(figures)
    assert len(figures["motion"].axes) == 2
    for name, figure in figures.items():
        assert all(axes.get_ylabel() for axes in figure.axes), name
        assert figure.axes[-1].get_xlabel() in ("time, s", "$x$, m", "$y$, m")
    names = [text.get_text() for text in figures["tip"].axes[0].texts]
    assert {"approach", "impact"} <= set(names)


@pytest.fixture(scope="module")
def many_legged(tmp_path_factory, ffsm_run):
    """A robot of 16 joints with long names."""
    names = [f"{side}_{joint}" for side in ("front_left", "front_right", "back_left", "back_right")
             for joint in ("hip_yaw", "hip_pitch", "knee_pitch", "ankle_roll")]  # fmt: skip
    bodies = "".join(f"""<body><joint name="{name}" axis="{i % 3} 1 0"/><geom size="0.1" pos="{i % 5} {i // 5} 1"/></body>"""
                     for i, name in enumerate(names))  # fmt: skip
    robot = f"""<mujoco>{HEAD}<worldbody><body name="hull"><freejoint name="free"/><geom size="0.1" mass="9"/>{bodies}</body>
      </worldbody><actuator>{"".join(f'<motor name="{n}_motor" joint="{n}"/>' for n in names)}</actuator></mujoco>"""
    law = {"kind": "pd", "joints": names, "kp": 1.0, "kd": 1.0}
    return ffsm_run(
        scene(
            tmp_path_factory.mktemp("legs"),
            robot,
            {},
            duration_s=0.01,
            initial={"joints": {f"robot/{name}": 0.1 * (i + 1) for i, name in enumerate(names)}},
            phases=[{"name": "move", "until": "end", "controller": law | {"target": [0.0] * len(names)}}],
        )
    )


@pytest.mark.long
def test_names_of_many_joints_fit(many_legged):
    figures = plots.figures(many_legged, ["joints", "torques"])
    for figure in figures.values():
        figure.draw_without_rendering()  # as it is laid out in a file
    legends = [axes.get_legend().get_window_extent() for axes in figures["joints"].axes]
    page = figures["joints"].bbox
    assert all(page.y0 <= legend.y0 and legend.y1 <= page.y1 for legend in legends)
    assert not legends[0].overlaps(legends[1])
    labels = [axes.yaxis.label.get_window_extent() for axes in figures["torques"].axes]
    assert len(labels) == 16
    assert not [(i, j) for i in range(16) for j in range(i) if labels[i].overlaps(labels[j])]


def test_many_curves_have_different_styles(many_legged):
    """Seven colours and seven line styles give 49 combinations."""
    lines = plots.figures(many_legged, ["joints"])["joints"].axes[0].get_legend().get_lines()
    looks = {(line.get_color(), str(line._dash_pattern)) for line in lines}
    assert len(looks) == len(lines) == 16


@pytest.mark.long
def test_the_same_data_give_the_same_bytes(hit, tmp_path):
    first, again = (plots.save(hit, tmp_path / name, ["motion", "momenta"]) for name in ("a", "b"))
    assert [path.name for path in first] == ["motion.png", "motion.svg", "momenta.png", "momenta.svg"]
    for one, other in zip(first, again, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert b"<dc:date>" not in first[1].read_bytes()


def test_the_case_study_is_drawn_from_the_log(baseline):
    """The robot of the paper in its plane: base actuators are not motors, and unused ones have no figure."""
    subject = Subject(baseline)
    assert subject.planes == (Plane(0, 1),)
    assert subject.named("motor") == ["robot/motor_1", "robot/motor_2", "robot/motor_3"]
    assert subject.named("thruster") == ["robot/thruster_x", "robot/thruster_y"]
    assert subject.named("wheel") == ["robot/wheel"]
    assert not subject.base_actuated
    np.testing.assert_allclose(subject.roots["robot"][0], [5.0, -1.75, 0.0], atol=1e-12)


def test_a_fixed_body_is_drawn_at_its_pose(tmp_path, ffsm_run):
    """In every pose and frame, in a colour of its own, and within the frame."""
    wall = f'<mujoco>{HEAD}<worldbody><geom name="wall" type="box" size="0.1 1 1"/></worldbody></mujoco>'
    path = scene(
        tmp_path,
        ball("ball", joints="xy"),
        {"wall": wall},
        fixed={"wall": {"position_m": [1.0, 0.5, 0.0]}},
        initial={"rates": {"robot/x": 1.0, "robot/y": 0.3}},
        duration_s=0.5,
    )
    run = ffsm_run(path)
    subject = Subject(run)
    plane = subject.planes[0]
    assert plane.names == ("x", "y")
    for qpos in (run.qpos[0], run.qpos[-1]):
        (shape,) = (each for each in subject.silhouette.outlines(qpos, plane) if each.tree == "world")
        np.testing.assert_allclose(shape.points.min(axis=0), (0.9, -0.5), atol=1e-12)
        np.testing.assert_allclose(shape.points.max(axis=0), (1.1, 1.5), atol=1e-12)
    # The ball is seen from -0.1 to 0.6 and 0.25 m; the wall as far as half of that beyond.
    left, right, bottom, top = view_box(subject, plane, [0, -1])
    assert left < -0.1
    assert 0.95 < right < 1.1
    assert -0.6 < bottom < -0.45
    assert 0.6 < top < 0.75
    film = animate(run).gif
    picture = np.array(Image.open(BytesIO(film)).convert("RGB"), dtype=int)
    grey = (np.ptp(picture, axis=2) <= 2) & (picture[:, :, 0] > 150) & (picture[:, :, 0] < 225)
    assert grey.mean() > 0.04  # with the wall 0.07; without it 0.02, the grid


def test_a_film_of_motion_in_space_has_three_views(spatial):
    """To one scale, with the legend in the fourth corner, without overlap."""
    subject = Subject(spatial)
    figure, views = pictures._from_three_sides(subject, [0, len(spatial.time) - 1], 0.0)
    figure.draw_without_rendering()
    top, corner, front, side = figure.axes
    assert [axes.get_xlabel()[1] + axes.get_ylabel()[1] for axes in (top, front, side)] == ["xy", "xz", "yz"]
    assert len(views) == 3
    assert corner.get_legend() is not None
    scales = {round(axes.bbox.width / np.ptp(axes.get_xlim()), 3) for axes in (top, front, side)}
    assert len(scales) == 1
    boxes = [axes.get_tightbbox() for axes in (top, front, side)] + [corner.get_legend().get_window_extent()]
    assert not [(i, j) for i in range(4) for j in range(i) if boxes[i].overlaps(boxes[j])]


def test_the_path_of_the_tip_changes_its_colour_at_the_first_impact(spatial):
    """The two parts share the point of the impact."""
    subject = Subject(spatial)
    before, after = subject.tip_parts
    assert before.colour != after.colour
    assert before.rows[-1] == after.rows[0]
    assert spatial.time[before.rows[-1]] == pytest.approx(subject.first_mark_s, abs=6e-3)  # steps of 5 ms
    names = [text.get_text() for text in plots.figures(spatial, ["motion"])["motion"].legends[0].get_texts()]
    assert names[:2] == ["tip, before", "tip, after"]


def test_texts_of_figures_do_not_overlap(spatial):
    """Names of phases, label of the marks, legends and axis labels of time plots."""
    for name, figure in plots.figures(spatial, ["tip", "momenta"]).items():
        figure.draw_without_rendering()
        words = [text.get_window_extent() for axes in figure.axes for text in axes.texts if text.get_text()]
        words += [axes.get_legend().get_window_extent() for axes in figure.axes if axes.get_legend()]
        words += [axes.yaxis.label.get_window_extent() for axes in figure.axes]
        close = [(i, j) for i in range(len(words)) for j in range(i) if words[i].overlaps(words[j])]
        assert not close, name
        for axes in figure.axes:
            legend = axes.get_legend()
            assert legend is None or not legend.get_window_extent().overlaps(axes.bbox), name


def test_time_labels_of_poses_do_not_overlap(spatial):
    """Including those of other bodies."""
    figure = plots.figures(spatial, ["motion"])["motion"]
    figure.draw_without_rendering()
    for axes in figure.axes:
        times = [text.get_window_extent() for text in axes.texts if text.get_text().endswith(" s")]
        assert times
        assert not [(i, j) for i in range(len(times)) for j in range(i) if times[i].overlaps(times[j])]


def test_limits_do_not_drive_the_range_of_a_panel(hit):
    """A curve of 0.2 within bounds of 40: 8 % beyond it, and the bounds in words; one that reaches them shows them."""
    for greatest, words in ((0.2, ["bounds 40"]), (40.0, [])):
        curve = Curve("torque", np.linspace(-greatest, greatest, len(hit.time)))
        bounds = [
            Curve(label, np.full(len(hit.time), side), is_limit=True) for label, side in (("bounds", -40.0), ("_", 40.0))
        ]
        (axes,) = stacked(hit, [Panel("m, N m", [*bounds, curve])]).axes
        low, high = axes.get_ylim()
        assert low == pytest.approx(-1.16 * greatest, rel=1e-12)
        assert 1.16 * greatest < high < 1.6 * greatest  # the label of the impact is above the curve
        assert [text.get_text() for text in axes.texts if text.get_text().startswith("bounds")] == words


def test_empty_panels_are_left_out(hit):
    zero, nothing = np.zeros(len(hit.time)), np.full(len(hit.time), np.nan)
    empty = Panel("unused", [Curve("zero", zero), Curve("bound", zero + 1.0, is_limit=True), Curve("none", nothing)])
    used = Panel("used", [Curve("smallest", zero + 1e-300)])
    assert [axes.get_ylabel() for axes in stacked(hit, [empty, used, empty]).axes] == ["used"]
    assert len(stacked(hit, [empty, empty]).axes) == 1  # a figure has at least one


def test_figures_bear_the_name_of_their_scenario(hit, tmp_path):
    assert plots.figures(hit, ["energies"])["energies"].get_suptitle() == "scene"
    (path,) = plots.save(hit, tmp_path, ["momenta"], ("svg",))
    assert "<!-- scene -->" in path.read_text()


def test_all_phases_of_a_figure_have_names(tmp_path, ffsm_run):
    """Four within a tenth of the run, on lines of their own."""
    short = [{"name": f"a_short_phase_{i}", "for_s": 0.01, "controller": {"kind": "off"}} for i in range(4)]
    rest = {"name": "the_others", "until": "end", "controller": {"kind": "off"}}
    figure = plots.figures(ffsm_run(two_balls(tmp_path, duration_s=0.5, phases=[*short, rest])), ["energies"])["energies"]
    figure.draw_without_rendering()
    texts = [text for text in figure.axes[0].texts if text.get_text() != "impact"]
    assert [text.get_text() for text in texts] == [*(f"a short phase {i}" for i in range(4)), "the others"]
    places = [text.get_window_extent() for text in texts]
    assert not [(i, j) for i in range(5) for j in range(i) if places[i].overlaps(places[j])]


ENDS = np.array([0.0, 0.5])


@pytest.mark.parametrize(("speed", "follows"), [(20.0, True), (0.5, False)])
def test_a_film_follows_a_robot_that_would_be_small(tmp_path, ffsm_run, speed, follows):
    """A ball of 0.2 m is shown in a square of 0.6 m around it if it flies 10 m, and in its whole motion of 0.25 m."""
    path = scene(tmp_path, ball("ball"), {}, initial={"rates": {"robot/free": [speed, 0, 0, 0, 0, 0]}}, duration_s=0.5)
    subject = Subject(ffsm_run(path))
    first, last = (
        (picture[..., 2].astype(int) - picture[..., 0] > 40).mean() for picture in pictures.pictures(subject, ENDS, 1.0)
    )
    assert min(first, last) > 0.005  # blue: a circle of 0.2 m in a view of 0.6 m, or in one of the whole motion
    assert (pictures._followed_m(subject, [0, -1]) == pytest.approx(0.6)) == follows


@pytest.mark.parametrize(("scenario", "changes"), [("servo-arm", {"initial.rates.lift": 0.5}), ("gripper-2f85", {})])
def test_the_effort_of_a_servo_is_its_force(ffsm_run, scenario, changes):
    """Its other columns are setpoints, in rad, m or without a unit, and their bounds are none of the force.

    A servo without a force has an empty panel, which is left out.
    """
    run = ffsm_run(scenario, {"duration_s": 0.05, **changes})
    keys = [key for key in run.keys if re.fullmatch(r"actuators\.robot_\w+_force_N(_m)?", key)]
    forces = {key: run[key] for key in keys if run[key].any()}
    axes = plots.figures(run, ["torques"])["torques"].axes
    drawn = {ax.get_ylabel().partition(",")[0].replace(" ", "_"): ax.lines for ax in axes}
    for key, force in forces.items():
        name = re.sub(r"actuators\.robot_(\w+)_force_N(_m)?", r"\1", key)
        curves = [line for line in drawn[name] if len(line.get_xdata()) > 2]  # others are marks
        assert [line.get_ydata()[-1] for line in curves] == [force[-1]]
    assert forces
