"""Recording of a scene at t = 0 for the Rerun viewer: what a scenario would start from."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.reach import Reach
from ffsm_mj.errors import LogWriteError
from ffsm_mj.log.camera import direction, framed_points
from ffsm_mj.log.drawing import (
    CheckedPair,
    DrawnShape,
    InitialScene,
    is_visual,
    marker_scale,
    shapes,
)
from ffsm_mj.log.palette import AXES, BLUE, FORCE, GREY, MARK, PALE, VERMILION, Colour, shares
from ffsm_mj.log.rerun.layout import BACKGROUND, UPRIGHT_VIEW, Framing
from ffsm_mj.log.rerun.plots import Recording
from ffsm_mj.log.rerun.scene import archetype, body_path, log_shapes, target_cross
from ffsm_mj.records.signals import identifier

_LABELLED_SITES, _LABELLED_PAIRS = 12, 8
"""Greatest numbers of sites and of pairs whose names are shown in the scene; the others show it on selection."""
_FAR_M = 1e3
"""Pairs at a greater distance are not connected by a line."""


class _Look(NamedTuple):
    """Colour of the geoms of one contact category, and its meaning."""

    colour: Colour
    opacity: float
    meaning: str


_RESOLVED = _Look(FORCE, 1.0, "contacts are resolved")
_IGNORED = _Look(PALE, 1.0, "all contacts are ignored")
_REPORTED = _Look(VERMILION, 1.0, "collides, but its contacts are only reported")
_VISUAL = _Look(BLUE, 0.25, "visual only")


def write_initial_scene(scene: InitialScene, path: Path) -> None:
    """Write the recording (``.rrd``) of a scene.

    Raises:
        LogWriteError: The file cannot be written.
    """
    recording = rr.RecordingStream(f"ffsm-mj {scene.name} at the start")
    data = rr.binary_stream(recording)
    _draw(Recording(recording), scene)
    try:
        path.write_bytes(data.read() or b"")
    except OSError as error:
        raise LogWriteError(path, error) from error
    finally:
        recording.disconnect()


def _draw(recording: Recording, scene: InitialScene) -> None:
    log, scale, system, data = recording.constant, marker_scale(scene.system), scene.system, scene.data
    log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    log("contacts", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    log_shapes(recording, system)
    for body in range(1, system.mj.nbody):
        log(body_path(system, body), _pose(data.xpos[body], data.xquat[body]))
    framing = _framing(scene)
    log("world/axes", framing.axes)
    _sites(log, scene, scale)
    for target in scene.targets:
        log(f"world/targets/{identifier(target.name)}", target_cross(target.point_m, target.name, scale))
    for centre in scene.centres:
        dot = rr.Points3D([centre.point_m], colors=[MARK], radii=[0.04 * scale], labels=[centre.name], show_labels=False)
        log(f"world/centres_of_mass/{identifier(centre.name)}", dot)
    for reach in scene.reaches:
        if np.isfinite(reach.radius_m):
            log(f"world/reach/{identifier(reach.tip)}", _sphere(reach))
    _contacts(log, scene, scale)
    log("notes", rr.TextDocument(_document(scene), media_type="text/markdown"))
    recording.stream.send_blueprint(_blueprint(framing))


def _pose(position: FloatArray, quaternion: FloatArray) -> rr.Transform3D:
    return rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=np.roll(quaternion, -1)))


def _framing(scene: InitialScene) -> Framing:
    """View of the moving bodies and the targets, from where most of tip and base is seen."""
    posed = scene.system, scene.data.xpos, scene.data.xquat
    points = np.vstack((framed_points(*posed), *(target.point_m for target in scene.targets)))
    back = direction(scene.view, posed, np.empty((0, 3)), points, UPRIGHT_VIEW)
    return Framing(points, half_view=UPRIGHT_VIEW, back=back)


def _sites(log: Any, scene: InitialScene, scale: float) -> None:
    """Frames of all sites; the names of many would cover each other."""
    system, labelled = scene.system, scene.system.mj.nsite <= _LABELLED_SITES
    for site in range(system.mj.nsite):
        name = system.mj.site(site).name
        vectors = 0.3 * scale * scene.data.site_xmat[site].reshape(3, 3).T
        frame = rr.Arrows3D(
            origins=[scene.data.site_xpos[site]] * 3,
            vectors=vectors,
            colors=AXES,
            radii=[0.012 * scale],
            labels=[name, "", ""],
            show_labels=labelled,
        )
        tree, _, short = name.partition("/")
        log(f"world/sites/{identifier(tree)}/{identifier(short)}", frame)


def _sphere(reach: Reach) -> rr.Ellipsoids3D:
    return rr.Ellipsoids3D(
        centers=[reach.centre_m],
        half_sizes=[[reach.radius_m] * 3],
        colors=[(*GREY, 60)],
        labels=[f"{reach.tip} is at most {reach.radius_m:.3g} m from {reach.joint}"],
        show_labels=False,
        fill_mode="majorwireframe",
    )


def _contacts(log: Any, scene: InitialScene, scale: float) -> None:
    """All geoms in the colours of their categories, and a line between the nearest points of each pair."""
    system, model = scene.system, scene.system.mj
    for shape in shapes(system, range(model.ngeom)):
        look = _look(scene, shape)
        parent = body_path(system, shape.body) if shape.body else "world/static"
        body = parent.replace("world", "contacts", 1)
        log(body, _pose(scene.data.xpos[shape.body], scene.data.xquat[shape.body]))
        tinted = DrawnShape(**{**vars(shape), "rgba": shares(look.colour, look.opacity)})
        log(f"{body}/{identifier(shape.name)}", archetype(tinted))
    lines = sorted((_gap(model, scene.data, pair) for pair in scene.pairs), key=lambda entry: entry[0])
    ranked = [entry for entry in lines if entry[0] < _FAR_M]
    for i, (gap, ends, pair) in enumerate(ranked):
        friction = f", mu = {pair.mu:g}" if pair.mu else ""
        line = rr.LineStrips3D(
            [ends],
            colors=[MARK],
            radii=[0.008 * scale],
            labels=[f"{pair.name}: {gap:.3g} m, e = {pair.restitution:g}{friction}"],
            show_labels=i < _LABELLED_PAIRS,
        )
        log(f"contacts/pairs/{identifier(pair.name)}", line)


def _look(scene: InitialScene, shape: DrawnShape) -> _Look:
    """Contact category of a geom."""
    if any(shape.geom in pair.geoms for pair in scene.pairs):
        return _RESOLVED
    if is_visual(scene.system.mj, shape.geom):
        return _VISUAL
    body, model = scene.system.mj.geom_bodyid[shape.geom], scene.system.mj
    others = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] != body and not is_visual(model, geom)]
    return _IGNORED if all(frozenset((shape.geom, other)) in scene.ignored for other in others) else _REPORTED


def _gap(model: Any, data: Any, pair: CheckedPair) -> tuple[float, FloatArray, CheckedPair]:
    """Signed distance in m and nearest points, (2, 3), m, of a pair."""
    if pair.nearest is not None:
        return *pair.nearest, pair
    ends = np.zeros(6)
    gap = float(mujoco.mj_geomDistance(model, data, *pair.geoms, _FAR_M, ends))
    return gap, ends.reshape(2, 3), pair


def _document(scene: InitialScene) -> str:
    """Text beside the scene."""
    looks = (_RESOLVED, _IGNORED, _REPORTED, _VISUAL)
    names = {FORCE: "green", PALE: "grey", VERMILION: "vermilion", BLUE: "transparent blue"}
    legend = "\n".join(f"- {names[look.colour]}: {look.meaning}" for look in looks)
    text = "\n".join(scene.lines)
    return f"```\n{text}\n```\n\n**Colours of geoms in the tab *Contacts***\n\n{legend}\n"


def _blueprint(framing: Framing) -> rrb.Blueprint:
    def view(name: str, origin: str) -> rrb.Spatial3DView:
        return rrb.Spatial3DView(
            name=name, origin=origin, line_grid=framing.ground, background=BACKGROUND, eye_controls=framing.eye
        )

    scene = view(f"Scene at t = 0, lines every {framing.grid_m:g} m", "/world")
    document = rrb.TextDocumentView(name="Scenario", origin="/notes")
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Tabs(scene, view("Contacts", "/contacts"), active_tab=0), document, column_shares=[1, 1]),
        rrb.TimePanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )
