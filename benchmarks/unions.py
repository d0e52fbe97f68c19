"""What contact with unions of many pieces costs: ``uv run python benchmarks/unions.py``.

The capture of ``probe-and-cone`` on its cone, and on a mesh of 64 sectors and 4 rings in place of it, which is decomposed; a
rod that rolls at e = 0 over 64 boxes side by side, and over one of their size, and that slides through a ring of 64, with an
impact at each edge: CPU time of whole runs in memory, the quickest of interleaved repeats. Then what is known of the normals
at one point, in microseconds of wall time.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from loops import in_memory
from solid import MANY, microseconds

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.contact.cells import cells, chosen_cell, separating_normals

MODELS = Path(__file__).parents[1] / "mjcf"
SECTORS, RINGS = 64, 4
THROAT_M, MOUTH_M, FROM_X_M, TO_X_M = 0.03, 0.13, -0.42, -0.54
"""Radii of the cone of ``probe-and-cone`` at its bottom and at its mouth, and where these are."""
SAG_M = -5e-4
"""Rings that were parts of one cone would become one: the middle of the wall stands in by this."""
WALL_M = 0.012
HALF_M, RADIUS_M = 0.1, 0.05
STRIP_M = 0.02
"""Half a rod and its radius; width of a box of the floor."""
CAPTURE_S = 25.0
STEP_S = 0.005


def funnel() -> str:
    """The mesh of the cone, as MJCF."""
    shares = np.linspace(0.0, 1.0, RINGS + 1)
    inner = THROAT_M + (MOUTH_M - THROAT_M) * shares - 4.0 * SAG_M * shares * (1.0 - shares)
    xs = FROM_X_M + (TO_X_M - FROM_X_M) * shares
    profile = [*zip(inner + WALL_M, xs, strict=True), *zip(inner[::-1], xs[::-1], strict=True)]
    angles = 2.0 * np.pi * np.arange(SECTORS) / SECTORS
    corners = np.array([[x, r * math.cos(angle), r * math.sin(angle)] for r, x in profile for angle in angles])
    count, triangles = len(profile), list[tuple[int, int, int]]()
    for k in range(count):
        for i in range(SECTORS):
            a, b = (k * SECTORS + j % SECTORS for j in (i, i + 1))
            d, c = ((k + 1) % count * SECTORS + j % SECTORS for j in (i, i + 1))
            triangles += [(a, c, b), (a, d, c)]
    vertices, faces = (" ".join(map(str, np.ravel(numbers).tolist())) for numbers in (corners, triangles))
    return f'<mesh name="funnel" inertia="exact" vertex="{vertices}" face="{faces}"/>'


def capture(*, pieces: bool) -> PreparedRun:
    """``probe-and-cone``, on its cone or on pieces."""
    changes: dict[str, Any] = {"duration_s": CAPTURE_S}
    if not pieces:
        return prepare("probe-and-cone", changes)
    stated = prepare("probe-and-cone", changes).scenario.model_dump(mode="json", exclude_none=True)
    text = (MODELS / "satellite_cone.xml").read_text()
    geom = '<geom name="cone" type="mesh" mesh="funnel" mass="0"/><site name="cone"'
    text = text.replace("<asset>", f"<asset>{funnel()}").replace('<site name="cone"', geom)
    stated["robot"] = {"mjcf": str(MODELS / "chaser_probe.xml")}
    stated["objects"] = {"satellite": {"mjcf": "satellite.xml", "decompose": {"mesh": "funnel"}}}
    return scene(stated, {"satellite.xml": text})


def rod(
    floor: str, place: list[float], rates: list[float], duration_s: float, gravity: str, mu: float, step_s: float = STEP_S
) -> PreparedRun:
    """A capsule along y on a fixed floor, e = 0."""
    head = f'<compiler angle="radian"/><option gravity="{gravity}"/>'
    spun = 0.4 * RADIUS_M**2
    body = f"""<body name="body"><freejoint name="free"/><inertial pos="0 0 0" mass="1" diaginertia="0.005 {spun} 0.005"/>
    <geom name="rod" type="capsule" size="{RADIUS_M} {HALF_M}" zaxis="0 1 0" mass="0"/></body>"""
    models = {
        name: f"<mujoco>{head}<worldbody>{inner}</worldbody></mujoco>"
        for name, inner in (("robot.xml", body), ("floor.xml", floor))
    }
    stated = {
        "name": "rod",
        "duration_s": duration_s,
        "time_step_s": step_s,
        "control_period_s": step_s,
        "conservative": False,
        "robot": {"mjcf": "robot.xml"},
        "objects": {"floor": {"mjcf": "floor.xml", "fixed": True}},
        "initial": {"joints": {"free": [*place, 1.0, 0.0, 0.0, 0.0]}, "rates": {"free": rates}},
        "contacts": {"rules": [{"between": ["robot", "floor"], "restitution": 0.0, "mu": mu}]},
        "phases": [{"name": "roll", "until": "end", "controller": {"kind": "off"}}],
    }
    return scene(stated, models)


def on_floor(boxes: int) -> PreparedRun:
    """It rolls at 0.5 m/s over a floor of boxes side by side along x."""
    width = SECTORS * STRIP_M / boxes
    geoms = "".join(
        f'<geom name="b{k}" type="box" size="{width / 2} 0.3 0.05" pos="{(k + 0.5) * width} 0 -0.05" mass="0"/>'
        for k in range(boxes)
    )
    return rod(geoms, [0.1, 0.0, RADIUS_M], [0.5, 0.0, 0.0, 0.0, 0.5 / RADIUS_M, 0.0], 2.0, "0 0 -9.81", 0.3)


def in_ring(step_s: float) -> PreparedRun:
    """It slides at 1 m/s through a ring of facets around y: an impact at each edge."""
    radius, texts = 0.3, []
    half = radius * math.tan(math.pi / SECTORS)
    for k in range(SECTORS):
        angle = 2.0 * math.pi * k / SECTORS
        x, z = (radius + 0.02) * math.sin(angle), -(radius + 0.02) * math.cos(angle)
        texts.append(f'<geom name="f{k}" type="box" size="{half} 0.3 0.02" pos="{x} 0 {z}" euler="0 {-angle} 0" mass="0"/>')
    start = [0.0, 0.0, RADIUS_M - radius]
    return rod("".join(texts), start, [1.0, 0.0, 0.0, 0.0, 1.0 / RADIUS_M, 0.0], 1.0, "0 0 0", 0.0, step_s)


def scene(stated: dict[str, Any], models: dict[str, str]) -> PreparedRun:
    """A scenario of texts."""
    with TemporaryDirectory() as folder:
        for name, text in models.items():
            (Path(folder) / name).write_text(text)
        path = Path(folder) / "scene.yaml"
        path.write_text(json.dumps(stated))  # JSON is YAML
        return prepare(path)


def at_a_point(of_a: FloatArray, of_b: Sequence[FloatArray]) -> FloatArray:
    """The normals that act where a piece of a meets some of b, each given by those of its faces there, at rest."""
    clauses = [separating_normals(of_a, normals) for normals in of_b]
    return chosen_cell(cells([clause for clause in clauses if len(clause)]), np.zeros(3), 1e-12, -of_a[0])


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    repeats = parser.parse_args().repeats
    pairs = {
        "capture into 256 pieces, into the cone": (capture(pieces=True), capture(pieces=False)),
        "rod over 64 boxes, over one": (on_floor(SECTORS), on_floor(1)),
        **{f"rod in a ring of 64 facets, steps of {1e3 * step_s:g} ms": (in_ring(step_s),) for step_s in (1e-3, STEP_S)},
    }
    for name, runs in pairs.items():
        spent = [min(times) for times in zip(*([in_memory(run) for run in runs] for _ in range(repeats)), strict=True)]
        steps = [run.scenario.ticks * run.scenario.steps_per_tick for run in runs]
        each = ", ".join(f"{1e6 * seconds / count:.0f}" for seconds, count in zip(spent, steps, strict=True))
        print(f"{name}: {each} us a step" + (f", ratio {spent[0] / spent[1]:.2f}" if len(runs) > 1 else ""))
    x, y, z = np.eye(3)
    floor = [np.array((z, x)), np.array((z, -x))]
    for name, of_a in (("face", np.array((-z,))), ("edge", np.array((-z, y))), ("corner", np.array((-z, x, y)))):
        print(f"{name} on a seam: {microseconds(lambda a=of_a: at_a_point(a, floor), MANY):.0f} us")


if __name__ == "__main__":
    main()
