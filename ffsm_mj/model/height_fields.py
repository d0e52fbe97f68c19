"""Heights of height fields as their files state them, and the prisms of those that are fixed to the world.

MuJoCo keeps elevations normalised to 0 to 1 in single precision. A slope of even steps is no longer even then, and its
triangles are in planes of their own. The numbers of the file are therefore read again, and normalised in double precision:
text as it is, each number in single precision as the shortest decimal that it stands for.
"""

from __future__ import annotations

import posixpath
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from ffsm_mj.arrays import FloatArray
from ffsm_mj.decomposition.terrain import height_prisms
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.meshes import decimals, numbers_in
from ffsm_mj.polytope import Polytope

_HEADER = 8
"""Bytes of the numbers of rows and columns before the elevations in a binary file."""
_LEVELS = 255
"""Number of steps between black and white in an image."""
_SINGLE = 2.0**-21
"""Rounding of a number from 0 to 1 in single precision, normalised by two operations."""


def fixed_terrain(model: Any, scene: Any, files: Mapping[str, ModelFiles]) -> dict[int, tuple[Polytope, ...]]:
    """Prisms of the height fields of fixed objects by geom id, in the axes of the geom.

    Args:
        model: Compiled scene.
        scene: Its specification.
        files: Files of each model by name.
    """
    fields, pieces = dict[int, tuple[Polytope, ...]](), dict[int, tuple[Polytope, ...]]()
    for geom in np.flatnonzero(model.geom_type == int(mujoco.mjtGeom.mjGEOM_HFIELD)).tolist():
        owner = files.get(model.geom(geom).name.partition("/")[0])
        if owner is None or owner.pose is None:
            continue
        field = int(model.geom_dataid[geom])
        if field not in fields:
            x, y, top, base = model.hfield_size[field].tolist()
            shares = _elevations(model, field, scene.hfield(model.hfield(field).name), owner)
            fields[field] = height_prisms(top * shares, np.array([x, y, base]))
        pieces[geom] = fields[field]
    return pieces


def _elevations(model: Any, field: int, source: Any, files: ModelFiles) -> FloatArray:
    """Elevations from 0 to 1, (nrow, ncol), the row at the least y first, by the numbers in the file.

    Args:
        model: Compiled scene.
        field: Id of the height field.
        source: Its specification.
        files: Files of its model.
    """
    shape = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    first = int(model.hfield_adr[field])
    normalised = model.hfield_data[first : first + shape[0] * shape[1]]
    if not source.file:
        numbers = _in_text(np.array(source.userdata, dtype=np.float32).reshape(shape), files)
    elif source.file.lower().endswith(".png") or "png" in source.content_type:
        numbers = _levels(normalised)
    else:
        base_name = posixpath.basename(source.file)
        content = next(data for name, data in files.files.items() if posixpath.basename(name) == base_name)
        numbers = decimals(np.frombuffer(content, dtype="<f4", offset=_HEADER))
    spread = float(np.ptp(numbers))
    shares = (numbers - numbers.min()) / spread if spread > 0.0 else np.zeros(len(numbers))
    return np.asarray(shares.reshape(shape))


def _in_text(single: npt.NDArray[np.float32], files: ModelFiles) -> FloatArray:
    """Elevations in a model file itself, (n,): the numbers in its text, whose first row is the one at the greatest y."""
    for element in files.elements("hfield"):
        exact = numbers_in(element.attributes.get("elevation", ""), single[::-1].ravel())
        if exact is not None:
            return np.asarray(exact.reshape(single.shape)[::-1].ravel())
    return decimals(single).ravel()


def _levels(normalised: npt.NDArray[np.float32]) -> FloatArray:
    """Levels of the points of an image above the darkest, in steps of the brightness, from shares of their greatest."""
    shares = normalised.astype(np.float64)
    levels = shares * np.arange(1, _LEVELS + 1)[:, None]
    off = np.abs(levels - np.round(levels)).max(axis=1)
    fits = off <= _SINGLE * np.arange(1, _LEVELS + 1)
    return np.asarray(np.round(levels[int(np.argmax(fits))]))
