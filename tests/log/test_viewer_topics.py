"""Topics for viewers, read with ``mcap`` and ``mcap-protobuf-support`` only."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from collections import defaultdict

import mujoco
import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

import ffsm_mj
from ffsm_mj.log.drawing import Frames, marker_scale, shapes
from ffsm_mj.log.foxglove import TransformsCodec, ViewerTopics, outline_cloud
from ffsm_mj.log.markers import ARROW_M
from ffsm_mj.log.mcap.sink import BlockWriter
from ffsm_mj.records.events import OUTCOME, OutcomeRecord, UnhandledContactRecord
from ffsm_mj.records.kinds import kind_of
from ffsm_mj.records.run_log import RunHeader
from ffsm_mj.records.signals import Layout, Signal, coordinate_keys
from tests.log.markers import scale_of
from tests.scenes import HEAD, ball, box, compile_paths, scene


def decoded(path):
    """Every message by topic, as (log time, message), in the order of the file's index."""
    found = defaultdict(list)
    with path.open("rb") as stream:
        for _, channel, message, content in make_reader(
            stream, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            found[channel.topic].append((message.log_time, content))
    return found


@pytest.fixture(scope="module")
def tumbling(tmp_path_factory):
    """Log and run of a ball that moves towards a spinning box."""
    folder = tmp_path_factory.mktemp("tumbling")
    path = scene(
        folder,
        ball("ball", mass=2.0, joints="x"),
        {"target": box("target")},
        initial={
            "joints": {"target/free": [1.6, 0.02, 0.01, 0.1, 0.5, -0.5, 0.7]},
            "rates": {"robot/x": 1.5, "target/free": [0.1, 0, 0, 0.3, 0.2, -0.4]},
        },
        contacts={"rules": [{"between": ["ball", "target/target"]}]},
        duration_s=0.55,
        log={"view_rate_hz": 40.0},
    )
    run = ffsm_mj.run(path, out=folder / "out", rerun=False)
    assert len(run.impacts) == 1
    return folder / "out" / "run.mcap", decoded(folder / "out" / "run.mcap"), run


def test_frames_are_the_bodies_at_the_view_rate(tumbling):
    """Compared with the rows: the coordinates of a free joint are the pose of its body; Foxglove uses xyzw."""
    _, topics, run = tumbling
    frames = topics["/tf"]
    assert [time for time, _ in frames] == [25_000_000 * k for k in range(23)]
    for time, message in frames:
        row = run.log.rows[time // 1_000_000]
        by_child = {transform.child_frame_id: transform for transform in message.transforms}
        assert set(by_child) == {"robot/ball", "target/target"}
        assert {transform.parent_frame_id for transform in message.transforms} == {"world"}
        assert {transform.timestamp.ToNanoseconds() for transform in message.transforms} == {time}
        moved = by_child["target/target"]
        place, turn = moved.translation, moved.rotation
        quaternion = row[5:9] / np.linalg.norm(row[5:9])
        np.testing.assert_allclose([place.x, place.y, place.z], row[2:5], rtol=0, atol=1e-15)
        np.testing.assert_allclose([turn.w, turn.x, turn.y, turn.z], quaternion, rtol=0, atol=1e-15)


def test_every_frame_of_the_scene_has_a_transform(tumbling):
    """A missing transform leaves a 3-D panel empty; the first transforms are not later than the scene."""
    _, topics, _ = tumbling
    ((time, update),) = topics["/scene"]
    assert time == topics["/tf"][0][0] == 0
    known = {"world"} | {transform.child_frame_id for transform in topics["/tf"][0][1].transforms}
    outlines = [cloud for topic, found in topics.items() if topic.startswith("/outline/") for _, cloud in found]
    assert {entity.frame_id for entity in update.entities} | {cloud.frame_id for cloud in outlines} <= known
    assert len(outlines) == 2
    assert all(entity.frame_locked and not entity.lifetime.ToNanoseconds() for entity in update.entities)
    (cube,) = next(entity for entity in update.entities if entity.id == "target/target").cubes
    assert (cube.size.x, cube.size.y, cube.size.z) == (1.0, 1.0, 1.0)  # whole edges, MuJoCo has halves


def test_an_impact_is_an_arrow_along_the_normal(tumbling):
    _, topics, run = tumbling
    (record,) = run.impacts
    ((time, update),) = topics["/scene/impacts"]
    ((same_time, impact),) = topics["/ffsm/impact"]
    assert time == same_time == round(record.time_s * 1e9)
    assert list(impact.qpos) == list(record.qpos)
    assert list(impact.qvel_before["target/free"].values) != list(impact.qvel_after["target/free"].values)
    (entity,) = update.entities
    assert entity.lifetime.ToNanoseconds() == 2_000_000_000
    (arrow,) = entity.arrows
    turn = arrow.pose.orientation
    direction = np.zeros(3)
    mujoco.mju_rotVecQuat(direction, np.array([1.0, 0, 0]), np.array([turn.w, turn.x, turn.y, turn.z]))
    np.testing.assert_allclose(direction, record.normal, atol=1e-12)
    length = arrow.shaft_length + arrow.head_length
    assert length == pytest.approx(scale_of(run) * np.clip(record.impulse_N_s, *ARROW_M))
    start = np.array([arrow.pose.position.x, arrow.pose.position.y, arrow.pose.position.z])
    np.testing.assert_allclose(start + length * direction, record.point_m, atol=1e-12)  # it ends there


def test_events_are_logged_as_text(tumbling):
    _, topics, _ = tumbling
    texts = [message.message for _, message in topics["/log"]]
    assert [text.split()[0] for text in (texts[0], texts[-1])] == ["phase", "completed"]
    (impact,) = texts[1:-1]
    assert re.match(r"impact \S+: impulse [0-9.e+-]+ N s, e = ", impact)
    overlap = UnhandledContactRecord(("a", "b"), 0.5, 1.25, 1e-3)
    kind = kind_of(overlap)
    assert kind.sentence(overlap) == "unhandled contact: a and b overlapped from 0.500 to 1.250 s, up to 0.001 m deep"
    assert (kind.time(overlap), kind.warning(overlap)) == (1.25, True)
    failed = OutcomeRecord("diverged", "qpos is not finite", 2.0, 2000, 1.0, 2000, 0, 0.0)
    assert (OUTCOME.sentence(failed), OUTCOME.warning(failed)) == ("diverged: qpos is not finite", True)


@pytest.mark.long
def test_rerun_reads_poses_outlines_and_text(tumbling, tmp_path):
    """Rerun's MCAP importer reads transforms by frame name, a cloud in each frame, and the text log."""
    path, _, _ = tumbling
    rerun = [sys.executable, "-m", "rerun"]
    subprocess.run([*rerun, "mcap", "convert", str(path), "-o", str(tmp_path / "x.rrd")], check=True, capture_output=True)
    shown = subprocess.run(
        [*rerun, "rrd", "print", "-v", str(tmp_path / "x.rrd")], check=True, capture_output=True, text=True
    ).stdout
    for words in ("/tf", "/outline/target/target", "Transform3D:translation", "Points3D:positions", "TextLog:text"):
        assert words in shown


def test_transforms_are_decoded_by_protobuf(rng):
    """The template with padded varints against Google's decoder, seconds and nanoseconds at their limits."""
    bodies, names = [3, 1], ["robot/base", "object/with a long name é" * 9]
    times = np.array([0, 1, 999_999_999, 1_000_000_000, 123_456_789_012_345, (2**35 - 1) * 1_000_000_000])
    frames = Frames(np.zeros(6), np.zeros((6, 1)), rng.normal(size=(6, 4, 3)), rng.normal(size=(6, 4, 4)))
    frames.positions[0] = 0.0
    for i, data in enumerate(TransformsCodec(bodies, names).encode(frames, times)):
        message = FrameTransforms.FromString(data.tobytes())
        assert [transform.child_frame_id for transform in message.transforms] == names
        for body, transform in zip(bodies, message.transforms, strict=True):
            place, turn = transform.translation, transform.rotation
            assert transform.timestamp.seconds * 1_000_000_000 + transform.timestamp.nanos == times[i]
            assert [place.x, place.y, place.z] == frames.positions[i, body].tolist()
            assert [turn.w, turn.x, turn.y, turn.z] == frames.quaternions[i, body].tolist()


ALL_SHAPES = f"""<mujoco>{HEAD}<asset><mesh name="wedge" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset><worldbody>
  <body name="all"><freejoint name="free"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <geom type="box" size=".1 .2 .3" pos="1 0 0" quat="0.8 0.6 0 0"/> <geom type="sphere" size=".1"/>
    <geom type="ellipsoid" size=".1 .2 .3"/> <geom type="cylinder" size=".1 .2"/> <geom type="capsule" size=".1 .2"/>
    <geom type="mesh" mesh="wedge"/> <geom type="sphere" size="9" group="3"/>
  </body></worldbody></mujoco>"""


@pytest.fixture
def all_shapes(tmp_path):
    (tmp_path / "all.xml").write_text(ALL_SHAPES)
    return compile_paths(tmp_path / "all.xml")


def distance_in_sizes(shape, points):
    """Distance of points from the surface of a geom, in its frame and relative to its size."""
    radius, half_length, _ = shape.size
    across, beyond = np.hypot(points[:, 0], points[:, 1]), np.abs(points[:, 2]) - half_length
    if shape.kind == "box":
        return np.max(np.abs(points) / shape.size, axis=1) - 1
    if shape.kind == "ellipsoid":
        return np.linalg.norm(points / shape.size, axis=1) - 1
    if shape.kind == "cylinder":
        return np.maximum(across - radius, beyond) / radius
    if shape.kind == "capsule":
        return np.hypot(across, np.maximum(beyond, 0)) / radius - 1
    return np.abs(points[:, None] - shape.vertices).max(axis=2).min(axis=1)


def test_outlines_lie_on_their_geoms(all_shapes):
    for shape in shapes(all_shapes):
        cloud = outline_cloud([shape], "all", 0)
        raw = np.frombuffer(cloud.data, dtype=np.uint8).reshape(-1, cloud.point_stride)
        points = np.ascontiguousarray(raw[:, :12]).view("<f4").astype(float)
        back, local = np.empty(4), np.empty_like(points)
        mujoco.mju_negQuat(back, shape.quaternion)
        for point, out in zip(points, local, strict=True):
            mujoco.mju_rotVecQuat(out, point - shape.position, back)
        surface = distance_in_sizes(shape, local)
        assert len(points) >= 4
        np.testing.assert_allclose(surface, 0, atol=2e-3)  # chords of 64 to a turn: 1 - cos(pi / 64) = 1.2e-3


def test_shapes_of_every_kind_are_drawn(all_shapes):
    kinds = [shape.kind for shape in shapes(all_shapes)]
    assert kinds == ["box", "ellipsoid", "ellipsoid", "cylinder", "capsule", "mesh"]
    viewer = ViewerTopics(all_shapes, 50.0)
    keys = ["state.time_s", *coordinate_keys(all_shapes.joints.values())]
    viewer.open(RunHeader("x", "", Layout(tuple(Signal(*key.split("."), "", "") for key in keys)), {}, {}))
    row = np.concatenate(([0.0], all_shapes.mj.qpos0))[None]
    update = next(data for topic, _, data in viewer.rows(row) if topic == "/scene")
    (entity,) = viewer.topics["/scene"].FromString(update.tobytes()).entities
    assert (len(entity.cubes), len(entity.spheres), len(entity.cylinders), len(entity.triangles)) == (1, 4, 2, 1)
    assert len(entity.triangles[0].indices) == 12


def test_plumes_show_the_firing_thrusters(tmp_path):
    """Opposite to the force, sent on changes, with all plumes in each message."""
    jets = """<mujoco>{}<worldbody><body name="bus"><freejoint name="free"/><geom size=".1" mass="1"/>
      <site name="left" pos="0 .1 0"/><site name="right" pos="0 -.1 0"/></body></worldbody><actuator>
      <motor name="left" site="left" gear="0 -1 0 0 0 0"/><motor name="right" site="right" gear="0 1 0 0 0 0"/>
      <motor name="twist" site="left" gear="0 0 0 0 0 1"/></actuator></mujoco>"""
    (tmp_path / "jets.xml").write_text(jets.format(HEAD))
    system = compile_paths(tmp_path / "jets.xml")
    keys = ["state.time_s", *coordinate_keys(system.joints.values())]
    keys += [f"actuators.robot_{jet}_{what}_N" for what in ("applied", "lower", "upper") for jet in ("left", "right")]
    layout = Layout(tuple(Signal(*key.split("."), "", "") for key in keys))
    viewer = ViewerTopics(system, 10.0)
    viewer.open(RunHeader("x", "", layout, {}, {}))
    rows = np.zeros((6, 14))
    rows[:, 0], rows[:, 4], rows[1:3, 8], rows[2:4, 9] = 0.1 * np.arange(6), 1.0, 2.0, 1.0
    sent = [
        (int(t[0]), viewer.topics[topic].FromString(d.tobytes())) for topic, t, d in viewer.rows(rows) if "plumes" in topic
    ]
    assert [(t // 100_000_000, [e.id for e in update.entities]) for t, update in sent] == [
        (1, ["robot/left"]),
        (2, ["robot/left", "robot/right"]),
        (3, ["robot/right"]),
        (4, []),
    ]
    assert all(update.deletions[0].type == 1 for _, update in sent)
    (cone,) = sent[0][1].entities[0].cylinders
    assert (sent[0][1].entities[0].frame_id, cone.pose.position.y) == (
        "robot/bus",
        pytest.approx(0.1 + 0.15 * marker_scale(system)),
    )  # 0.3 m long


def test_a_plume_of_a_thruster_on_a_joint_of_the_base_follows_it_in_every_frame(tmp_path):
    """Its direction is fixed in the world, so it has no frame of a body; the last message shows none."""
    (tmp_path / "ball.xml").write_text(ball("ball", joints="x"))
    keys = [
        "state.time_s",
        "state.q_robot_x_m",
        *(f"actuators.robot_push_x_{what}_N" for what in ("applied", "lower", "upper")),
    ]
    system = compile_paths(tmp_path / "ball.xml")
    viewer = ViewerTopics(system, 10.0)
    viewer.open(RunHeader("x", "", Layout(tuple(Signal(*key.split("."), "", "") for key in keys)), {}, {}))
    rows = np.zeros((5, 5))
    rows[:, 0], rows[:, 1], rows[1:4, 2] = 0.1 * np.arange(5), 0.5 * np.arange(5), 2.0
    sent = [viewer.topics[topic].FromString(data.tobytes()) for topic, _, data in viewer.rows(rows) if "plumes" in topic]
    cones = [
        (entity.frame_id, cone.pose.position.x) for update in sent for entity in update.entities for cone in entity.cylinders
    ]
    # 0.3 m long at scale 1, against the push.
    assert cones == [("world", pytest.approx(0.5 * i - 0.15 * marker_scale(system))) for i in (1, 2, 3)]
    assert len(sent) == 4
    assert not sent[-1].entities


def test_a_block_is_written_as_by_the_mcap_package(rng):
    """Byte for byte, which tests the private parts of ``mcap`` that ``BlockWriter`` uses."""
    blocks = [(1, np.arange(5) * 10, rng.integers(0, 255, (5, 40), dtype=np.uint8))]
    blocks += [(2, np.array([7]), rng.integers(0, 255, (1, 3), dtype=np.uint8))]
    blocks += [(1, 50 + np.arange(3), rng.integers(0, 255, (3, 40), dtype=np.uint8))]
    files = []
    for kind in (Writer, BlockWriter):
        stream = io.BytesIO()
        writer = kind(stream, enable_data_crcs=True)
        writer.start()
        for topic in ("a", "b"):
            writer.register_channel(topic, "", 0)
        for channel, times, messages in blocks:
            if kind is BlockWriter:
                writer.add_block(channel, times, messages)
            else:
                for time, message in zip(times.tolist(), messages, strict=True):
                    writer.add_message(channel, log_time=time, data=message.tobytes(), publish_time=time)
            writer.flush()
        writer.finish()
        files.append(stream.getvalue())
    assert files[0] == files[1]
