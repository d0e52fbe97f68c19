"""The gallery: a picture of each shipped scenario at its first event, and the page of its run.

``make gallery`` draws the pictures, ``docs/images/gallery``, and writes ``docs/gallery.md``: MuJoCo's renderer draws off
screen, and without a display needs ``MUJOCO_GL=egl``. ``make docs`` writes the pages (``--pages``) to ``build/gallery``,
from where the site takes them: there a picture opens the page. ``--text`` prints ``docs/gallery.md``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np
from piece_pictures import HEIGHT, WIDTH, rendered
from PIL import Image

import ffsm_mj
from ffsm_mj.log.camera import SeenScene, aimed, framed_points
from ffsm_mj.log.drawing import colour_of, geoms_to_draw
from ffsm_mj.report.page import write_page
from ffsm_mj.scenario.shipped import scenario_names

DOCS = Path(__file__).parent
PICTURES, PAGES = DOCS / "images" / "gallery", DOCS.parent / "build" / "gallery"
COLUMNS = 3
SIZE = (330, 270)
COLOURS = 64
EXPLAINED = {
    "air-bearing": "phases.md#playback",
    "baseline": "verified-result.md",
    "berth": "missions.md#berth",
    "capture": "capture.md",
    "capture-camera": "capture-by-camera.md",
    "capture-detumble": "capture-detumble.md",
    "capture-flexible": "joints.md#flexible-joints",
    "capture-orbit": "missions.md#capture-in-orbit",
    "capture-planar": "capture.md",
    "coasting": "sensitivity.md",
    "gripper-2f85": "grippers.md#linkage-gripper",
    "handrail": "missions.md#handrail",
    "nozzle-capture": "missions.md#nozzle-capture",
    "probe-and-cone": "missions.md#probe-and-cone",
    "servo-arm": "grippers.md#an-arm-with-its-own-servos-is-hit",
    "spatial": "own-robot.md",
    "spin-transfer": "friction.md",
    "squeeze": "grippers.md#grasp-by-friction",
    **dict.fromkeys(("dock", "push", "resting", "tap"), "persistent-contact.md"),
    **dict.fromkeys(("free-flying", "free-flying-hardware", "no-actuation", "slow-impact"), "reproduction.md"),
}
"""Page of docs/ that explains each scenario."""
_HALF = np.tan(np.radians(22.5))
"""Tangent of half the field of view of MuJoCo's free camera."""


def text() -> str:
    """The page: cells with a picture, the name and what the scenario says of itself."""
    cells = []
    for name in scenario_names():
        described = " ".join(str(ffsm_mj.Scenario.load(name).description).split())
        cells.append(f"[![{name}](images/gallery/{name}.png)]({EXPLAINED[name]})<br>**`{name}`** {described}")
    cells += [""] * (-len(cells) % COLUMNS)
    rows = [cells[k : k + COLUMNS] for k in range(0, len(cells), COLUMNS)]
    begins = [
        "# Gallery",
        "",
        "Every shipped scenario at its first contact or grasp: `ffsm run NAME`, then `ffsm view`. On the site",
        "(`make docs`) a picture opens the page of the run, with its scene in 3-D; else the page that explains it.",
        "",
        "| " * COLUMNS + "|",
        "|---" * COLUMNS + "|",
    ]
    return "\n".join([*begins, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def picture(name: str, run: ffsm_mj.Run) -> None:
    """Draw a run at its first contact or grasp, from where viewers look at it."""
    system = ffsm_mj.Scenario.load(name).system
    model, data = system.mj, mujoco.MjData(system.mj)
    events = sorted([*run.impacts, *run.grasps], key=lambda event: event.time_s)
    contacts = np.array([hit.point_m for hit in run.impacts[:1]]).reshape(-1, 3)
    data.qpos[:] = run.qpos[int(np.searchsorted(run.time, events[0].time_s)) if events else -1]
    mujoco.mj_forward(model, data)
    points = framed_points(system, data.xpos, data.xquat)
    half_view = (_HALF * WIDTH / HEIGHT, _HALF)
    back = SeenScene(system, data.xpos.copy(), data.xquat.copy(), contacts).best(points, half_view)
    eye, centre = aimed(points, back, half_view)
    drawn = set(geoms_to_draw(model))
    for geom in range(model.ngeom):
        model.geom_group[geom] = 0 if geom in drawn else 5
        model.geom_matid[geom], model.geom_rgba[geom] = -1, colour_of(system, geom)
    model.site_group[:] = 5
    seen = rendered(
        model,
        data,
        lookat=centre,
        distance=float(np.linalg.norm(eye - centre)),
        azimuth=float(np.degrees(np.arctan2(-back[1], -back[0]))),
        elevation=float(-np.degrees(np.arcsin(back[2]))),
    )
    PICTURES.mkdir(parents=True, exist_ok=True)
    small = Image.fromarray(seen).resize(SIZE, Image.Resampling.LANCZOS)
    small.quantize(COLOURS).save(PICTURES / f"{name}.png", optimize=True)


def main() -> None:
    """Run all shipped scenarios, or those named, and draw them or write their pages."""
    options = [word for word in sys.argv[1:] if word.startswith("--")]
    if options == ["--text"]:
        print(text(), end="")
        return
    for name in sys.argv[1 + len(options) :] or scenario_names():
        run = ffsm_mj.run(name)
        if options == ["--pages"]:
            PAGES.mkdir(parents=True, exist_ok=True)
            print(f"{name}: {write_page(run, PAGES / f'{name}.html')}")
        else:
            picture(name, run)
    if not options:
        (DOCS / "gallery.md").write_text(text(), encoding="utf-8")


if __name__ == "__main__":
    main()
