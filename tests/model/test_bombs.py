"""Input beyond stated limits is refused in one line, before memory or disk is allocated."""

from __future__ import annotations

import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

import mujoco
import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader

import ffsm_mj
from ffsm_mj._core.polygons import hull
from ffsm_mj.assembly import assemble
from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError, LogError
from ffsm_mj.log import limits
from ffsm_mj.log.drawing import shapes
from ffsm_mj.log.foxglove import outline_cloud
from ffsm_mj.log.mcap.format import layout_of_schema
from ffsm_mj.report.plots.silhouette import Plane, Silhouette
from tests.model.test_stranger import forged
from tests.scenes import HEAD, compile_paths, two_balls

LIMITED = """import resource, sys
resource.setrlimit(resource.RLIMIT_AS, ({most}, {most}))
from ffsm_mj.cli.main import main
sys.exit(main(sys.argv[1:]))"""
MOST_BYTES = 3 << 30  # address space: the libraries alone map over 1 GiB


def limited(*arguments: str) -> tuple[int, str, float]:
    """Run a command in a process limited to 3 GiB; returns exit code, standard error and wall time in s."""
    start = time.monotonic()
    command = [sys.executable, "-c", LIMITED.format(most=MOST_BYTES), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stderr, time.monotonic() - start


# --- scenarios --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("duration_s=4e5", "duration_s: 400000000 control periods of "),
        ("duration_s=1e300", "duration_s: is 1e+303 times control_period_s"),
        ("time_step_s=1e-300", "control_period_s: is 1e+297 times time_step_s"),
        ("duration_s=30000", "log.view_rate_hz: gives 1.5e+06 frames for viewers; at most 1e+06"),
        ("log.max_size_GB=1e-6", "duration_s: 1000 control periods"),
    ],
)
@pytest.mark.parametrize("command", ["check", "run"])
def test_runs_beyond_the_limits_are_refused(tmp_path, capsys, monkeypatch, override, expected, command):
    monkeypatch.chdir(tmp_path)
    rate = [] if "view_rate" in expected else ["-s", "log.view_rate_hz=1e-3"]
    assert main([command, str(two_balls(tmp_path)), "-s", override, *rate]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
    assert not (tmp_path / "logs").exists()


def test_a_limit_is_raised_by_a_key(tmp_path, capsys):
    overrides = ["-s", "log.view_rate_hz=1e-3", "-s", "duration_s=4e5", "-s", "log.max_size_GB=1000"]
    assert main(["check", str(two_balls(tmp_path)), *overrides]) == 0
    assert "400000000 control ticks" in capsys.readouterr().out


def test_a_run_must_fit_on_disk_or_in_memory(tmp_path, capsys, monkeypatch):
    path = two_balls(tmp_path)
    monkeypatch.setattr(assemble, "_free", lambda folder: 1000 if folder.name == "out" else 1 << 40)
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{tmp_path}/out: the run takes ")
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr(assemble, "_memory", lambda: 1000)
    with pytest.raises(InputError, match="of memory, this machine has 1e-06 GB; give it a folder"):
        ffsm_mj.run(path)
    assert ffsm_mj.run(path, out=tmp_path / "fits", rerun=False).outcome == "completed"


def test_the_estimate_is_an_upper_bound(tmp_path):
    """The uncompressed size bounds the samples in the file, which also has headers and topics for viewers."""
    run = ffsm_mj.run(two_balls(tmp_path, duration_s=5.0), out=tmp_path / "out", rerun=False)
    size = (tmp_path / "out" / "run.mcap").stat().st_size
    bound = assemble.logged_bytes(len(run.time), len(run.keys))
    assert bound / assemble._BEST_COMPRESSION / 4 < size < bound


# --- models -----------------------------------------------------------------------------------------------------------

REPEATED = '<replicate count="{n}" offset="1 0 0">{inner}</replicate>'
GEOM = '<geom size="1" mass="1"/>'
PNG_HEAD = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\x7f\xff\xff\xff\0\0\xff\xff\x08\x02\0\0\0"


@pytest.mark.parametrize(
    ("top", "inner", "expected"),
    [
        ('<asset><texture name="t" type="2d" builtin="flat" width="9999" height="9999"/></asset>', "", "more than 67108864"),
        ('<asset><texture name="t" type="cube" builtin="flat" width="9999"/></asset>', "", "more than 67108864 pixels"),
        ('<asset><texture name="t" type="2d" file="bomb.png"/></asset>', "", "more than 67108864 pixels"),
        ('<asset><hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/></asset>', "", "more than 67108864 pixels"),
        ("", REPEATED.format(n=10**8, inner=GEOM), "more than 200000 elements, including repeated ones"),
        ("", REPEATED.format(n=3e4, inner=REPEATED.format(n=30000, inner=GEOM)), "more than 200000 elements"),
        ("", REPEATED.format(n=30000, inner='<include file="many.xml"/>'), "more than 200000 elements"),
        ("", '<flexcomp name="x" type="grid" count="1000 1000 1000"/>', "<flexcomp count='1000 1000 1000'> requests more"),
        ('<size memory="1000G"/>', "", "<size memory='1000G'> requests more than 1.07374e+09"),
        ('<size nkey="2000000000"/>', "", "<size nkey='2000000000'> requests more than 100000"),
        ('<asset><mesh name="m" builtin="plate" params="50000 50000"/></asset>', "", "<mesh params='50000 50000'> requests"),
    ],
)
def test_elements_beyond_the_limits_are_refused(tmp_path, top, inner, expected):
    (tmp_path / "bomb.png").write_bytes(PNG_HEAD)
    (tmp_path / "many.xml").write_text(f"<mujocoinclude>{GEOM * 10}</mujocoinclude>")
    path = two_balls(tmp_path)
    text = (tmp_path / "robot.xml").read_text().replace("<worldbody>", f"{top}<worldbody>")
    (tmp_path / "robot.xml").write_text(text.replace("</body>", f"{inner}</body>"))
    start = time.monotonic()
    with pytest.raises(InputError) as refused:
        ffsm_mj.run(path)
    (line,) = refused.value.lines
    assert line.startswith(f"{tmp_path}/")
    assert expected in line
    assert time.monotonic() - start < 20.0  # MuJoCo itself is at it for minutes


# --- logs -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("log")
    ffsm_mj.run(two_balls(folder, duration_s=0.1), out=folder / "run", rerun=False)
    return folder / "run" / "run.mcap"


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def message(size: int, channel: int = 1) -> bytes:
    return record(5, struct.pack("<HIQQ", channel, 0, 0, 0) + bytes(size))


def chunk(content: bytes, *, stated: int | None = None, packed: bytes | None = None) -> bytes:
    """A chunk with a valid checksum; it may state a larger size."""
    packed = zstandard.ZstdCompressor().compress(content) if packed is None else packed
    size = len(content) if stated is None else stated
    head = struct.pack("<QQQII", 0, 0, size, zlib.crc32(content), 4) + b"zstd"
    return record(6, head + struct.pack("<Q", len(packed)) + packed)


def frame_of(stated: int, content: bytes) -> bytes:
    """A zstd frame whose header states a larger size."""
    frame = zstandard.ZstdCompressor(write_content_size=False).compress(content)
    return frame[:4] + bytes([frame[4] | 0xC0]) + frame[5:6] + struct.pack("<Q", stated) + frame[6:]


def loaded(log: Path, path: Path, bomb: bytes) -> Path:
    """The log with a record inserted before its first chunk."""
    whole = log.read_bytes()
    at = whole.index(b"\x04\x00\x00\x00zstd") - 9 - 28
    path.write_bytes(whole[:at] + bomb + whole[at:])
    return path


@pytest.mark.long
@pytest.mark.parametrize("in_frame", [False, True])
def test_a_chunk_that_states_8_gib_is_damage(tmp_path, log, in_frame):
    bomb = chunk(b"x" * 100, stated=8 << 30, packed=frame_of(8 << 30, b"x" * 100) if in_frame else None)
    code, complaint, _ = limited("analyze", str(loaded(log, tmp_path / "bomb.mcap", bomb)))
    assert code == 4
    assert "Traceback" not in complaint
    run = ffsm_mj.load_run(tmp_path / "bomb.mcap")
    assert run.damage.startswith(f"{len(bomb)} of ")
    assert np.array_equal(run.qpos, ffsm_mj.load_run(log).qpos)


@pytest.mark.long
def test_a_frame_that_states_more_than_its_chunk_is_damage(tmp_path, log):
    bomb = chunk(b"x" * 100, packed=frame_of(8 << 30, b"x" * 100))
    code, complaint, _ = limited("export", str(loaded(log, tmp_path / "bomb.mcap", bomb)), "--csv")
    assert code == 4, complaint
    assert "damaged: " in complaint
    assert ffsm_mj.load_run(tmp_path / "bomb.mcap").damage.startswith(f"{len(bomb)} of ")


def test_chunks_too_large_for_their_file_are_refused(tmp_path, log, monkeypatch):
    """Twenty chunks of 2 MB in a few kB, with the limits reduced by the same factor."""
    monkeypatch.setattr(limits, "UNPACKED_BYTES", 1 << 20)
    path = loaded(log, tmp_path / "bomb.mcap", chunk(message(2 << 20)) * 20)
    monkeypatch.setattr(limits, "UNPACKED_RATIO", 50)
    with pytest.raises(LogError, match=r"bomb\.mcap: its chunks contain \d+ bytes or more, too many for its length"):
        ffsm_mj.load_run(path)
    monkeypatch.undo()
    assert not ffsm_mj.load_run(log).damage


@pytest.mark.long
def test_a_chunk_of_too_many_different_records_is_damage(tmp_path, log):
    bomb = chunk((message(0) + message(0, 2)) * 60_000)
    start = time.monotonic()
    run = ffsm_mj.load_run(loaded(log, tmp_path / "bomb.mcap", bomb))
    assert run.damage.startswith(f"{len(bomb)} of ")
    assert time.monotonic() - start < 20.0


def test_too_many_records_or_events_are_refused(tmp_path, log, monkeypatch):
    monkeypatch.setattr(limits, "PARTS", 1000)
    with pytest.raises(LogError, match="more than 1000 different records"):
        ffsm_mj.load_run(loaded(log, tmp_path / "parts.mcap", chunk((message(0) + message(0, 2)) * 600)))
    impacts = next(c.id for c in channels(log) if c.topic == "/ffsm/impact")
    monkeypatch.setattr(limits, "EVENTS", 100)
    with pytest.raises(LogError, match="more than 100 events on /ffsm/impact"):
        ffsm_mj.load_run(loaded(log, tmp_path / "events.mcap", chunk(message(0, impacts) * 101)))


def channels(log: Path) -> list:
    with log.open("rb") as stream:
        return list(make_reader(stream).get_summary().channels.values())


def test_attachments_beyond_limits_are_refused(tmp_path, log, monkeypatch):
    def attached(size: int) -> bytes:
        body = struct.pack("<QQI", 0, 0, 1) + b"a" + struct.pack("<I", 0) + struct.pack("<Q", size) + bytes(size)
        return record(9, body + struct.pack("<I", zlib.crc32(body)))

    path = loaded(log, tmp_path / "bomb.mcap", attached(100_000) * 3)
    assert "cannot be read" not in ffsm_mj.load_run(path).damage
    monkeypatch.setattr(limits, "RECORD_BYTES", 90_000)
    assert ffsm_mj.load_run(path).damage.startswith(f"{3 * len(attached(100_000))} of ")
    monkeypatch.undo()
    monkeypatch.setattr(limits, "ATTACHED_BYTES", 200_000)
    with pytest.raises(LogError, match="GiB of attachments"):
        ffsm_mj.load_run(path)


def test_a_schema_of_millions_of_columns_is_refused():
    with pytest.raises(ValueError, match="a schema of 5000000 bytes"):
        layout_of_schema(bytes(5_000_000), {})


def test_aliases_of_aliases_in_the_scenario_of_a_log_are_refused(tmp_path, log):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    path = forged(log, tmp_path / "bomb.mcap", {"scenario.yaml": "\n".join(lines).encode()})
    code, complaint, _ = limited("export", str(path), "--gif")
    (line,) = complaint.splitlines()
    assert code == 2
    assert "scenario.yaml:5:5: 111111 values, aliases counted each time; at most 20000 are read" in line


# --- what is drawn ----------------------------------------------------------------------------------------------------


def drawn(folder: Path, geoms: str, asset: str = ""):
    body = f'<body name="b"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{geoms}</body>'
    (folder / "r.xml").write_text(f"<mujoco>{HEAD}{asset}<worldbody>{body}</worldbody></mujoco>")
    return compile_paths(folder / "r.xml")


@pytest.mark.parametrize("size", ["1e5 1e5 1e5", "1e9 1 1e-3"])
@pytest.mark.parametrize("kind", ["box", "ellipsoid", "capsule"])
def test_an_outline_of_a_large_geom_has_few_points(tmp_path, kind, size):
    system = drawn(tmp_path, f'<geom type="{kind}" size="{size}"/><geom type="box" size="1 1 1"/>')
    cloud = outline_cloud(list(shapes(system)), "b", 0)
    assert len(cloud.data) <= 16 * (100_000 + 2 * 40)  # two ends for each of the few edges, however short
    assert len(cloud.data) >= 16 * 50_000


def fan(count: int) -> str:
    """OBJ file of a sphere with about ``count`` vertices."""
    n = int(np.sqrt(count))
    a, b = np.meshgrid(np.linspace(0.1, 3.0, n), np.linspace(0.0, 6.28, n, endpoint=False), indexing="ij")
    points = np.stack((np.sin(a) * np.cos(b), 2.0 * np.sin(a) * np.sin(b), 3.0 * np.cos(a)), -1).reshape(-1, 3)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n)[None]).ravel() + 1
    j = i - np.arange(len(i)) % n + (np.arange(len(i)) + 1) % n
    faces = np.vstack((np.column_stack((i, i + n, j)), np.column_stack((j, i + n, j + n))))
    return "\n".join([*("v {:.6f} {:.6f} {:.6f}".format(*p) for p in points), *("f {} {} {}".format(*f) for f in faces)])


def test_many_copies_of_a_large_mesh_are_drawn_as_boxes(tmp_path, monkeypatch):
    (tmp_path / "m.obj").write_text(fan(400))
    asset = '<asset><mesh name="m" file="m.obj"/></asset>'
    system = drawn(tmp_path, '<geom type="mesh" mesh="m"/>' * 5, asset)
    monkeypatch.setattr("ffsm_mj.log.limits.MESH_CORNERS", 2 * 3 * int(system.mj.mesh_facenum[0]))
    found = list(shapes(system))
    assert [shape.kind for shape in found] == ["mesh", "mesh", "box", "box", "box"]
    inside = np.abs(found[0].vertices) <= found[2].size + 1e-6
    assert inside.all()
    assert (np.abs(found[0].vertices).max(axis=0) > 0.9 * found[2].size).all()


def test_the_silhouette_of_a_large_mesh_uses_its_extreme_vertices(tmp_path):
    (tmp_path / "m.obj").write_text(fan(10_000))
    system = drawn(tmp_path, '<geom name="g" type="mesh" mesh="m"/>', '<asset><mesh name="m" file="m.obj"/></asset>')
    (outline,) = Silhouette(system).outlines(np.array(system.mj.qpos0), Plane(0, 1))
    data = mujoco.MjData(system.mj)
    mujoco.mj_kinematics(system.mj, data)
    rotation = data.geom_xmat[0].reshape(3, 3)
    whole = hull(system.mj.mesh_vert @ rotation[[0, 1]].T) + data.geom_xpos[0][:2]

    def area(p: np.ndarray) -> float:
        return 0.5 * abs(np.sum(p[:, 0] * np.roll(p[:, 1], -1) - p[:, 1] * np.roll(p[:, 0], -1)))

    # 2000 directions are 0.08 rad apart, points up to 3 times that on this ellipsoid of 1 : 2 : 3: a chord over 0.24 rad
    # cuts off less than 0.24^2 / 8 = 0.7 % of the radius, which is twice that of the area.
    assert (1.0 - 0.014) * area(whole) < area(outline.points) <= area(whole)


def test_animations_of_too_many_frames_are_refused(tmp_path, capsys):
    assert main(["run", str(two_balls(tmp_path)), "--out", str(tmp_path / "out"), "--no-rerun"]) == 0
    capsys.readouterr()
    assert main(["export", str(tmp_path / "out"), "--gif", "--speed", "1e-9"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("1 s at 1e-09 times real time need 2e+10 frames, more than 6000; raise --speed or lower --fps")
