"""``measured-sphere``: oblique impacts of spheres without spin, by friction without and with tangential compliance."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError
from ffsm_mj.identification.fit import predicted
from ffsm_mj.identification.impacts import MeasuredImpacts
from ffsm_mj.scenario.contacts import ElasticConfig
from ffsm_mj.validation.measured.source import DataSource, GroupReport, Progress, ReportTable, digest, other_versions

_FILE = "examples/dem/3d-oblique-wall-impact/oblique_wall_impact_postprocessing.py"
_ANGLES, _RATIOS = "theta_restitution_exp", "restitution_exp"
SOURCE = DataSource(
    "chaos-polymtl/lethe",
    "255b5192",
    "Apache-2.0 WITH LLVM-exception OR LGPL-2.1-or-later",
    {_FILE: "846573462a5c753689a7aa508c3ac941acac0cfc4c667f99aabd37a2118ccc85"},
    "Kharaz, Gorham & Salman 2001, Powder Technology 120(3), 281-291: 5 mm spheres of alumina on glass",
)
MU, E = 0.092, 0.98
"""Coefficients of the experiment, as the manual of MFiX's verification cases quotes them (DEM05); nothing is fitted."""
ELASTIC = ElasticConfig(poisson_ratio=(0.23, 0.25), young_modulus_Pa=(380e9, 70e9))
"""Alumina and glass, as the simulation beside the data has them."""
RADIUS_M = 0.0025
LAWS = ("stronge", "compliant")
_NEARLY_NORMAL_DEG = 9.0
"""Below this the tangential motion is small beside errors of the measurement, and the ratio is poorly known."""
_ROLLING = 3.5
"""1 + m R^2 / I of a solid sphere: what an impulse changes the slip by, over the velocity of the centre."""
_ALLOWED = 1e-12
"""The law against the closed form: its impulse is rounded, and relative to the slip by at most 1e-13."""


def read(folder: Path) -> tuple[FloatArray, FloatArray, str]:
    """Angles from the normal, degrees, measured ratios e_t of tangential speeds, and the SHA-256 of the file.

    The file is a script: its lists of numbers are read from its syntax tree, and nothing of it is executed.

    Raises:
        InputError: The file is missing, is no Python, or has other lists.
    """
    path = folder / _FILE
    try:
        data = SOURCE.read(folder, _FILE)
        tree = ast.parse(data)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"{path}: not Python that can be read ({error})") from None
    angles, ratios = (_list_of(tree, name, path) for name in (_ANGLES, _RATIOS))
    if len(angles) != len(ratios):
        raise InputError(f"{path}: {len(angles)} numbers in {_ANGLES}, {len(ratios)} in {_RATIOS}: one for each impact")
    # Impacts of a series are not all within 1.6 deg of the normal: those are radians.
    if not np.all((angles > 0.0) & (angles < 90.0)) or angles.max() < 0.5 * np.pi:
        raise InputError(f"{path}: {_ANGLES}: degrees between 0 and 90 are allowed")
    if not np.all((ratios > 0.0) & (ratios < 1.5)):
        raise InputError(f"{path}: {_RATIOS}: ratios of tangential speeds, between 0 and 1.5, are allowed")
    return angles, ratios, digest(data)


def _list_of(tree: ast.Module, name: str, path: Path) -> FloatArray:
    """The list of numbers that a script assigns to a name.

    Raises:
        InputError: There is none, or it is no list of numbers.
    """
    for node in tree.body:
        if isinstance(node, ast.Assign) and any(isinstance(to, ast.Name) and to.id == name for to in node.targets):
            try:
                values = np.array(ast.literal_eval(node.value), dtype=np.float64)
            except (ValueError, TypeError, OverflowError):
                values = np.zeros(0)
            if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
                raise InputError(f"{path}:{node.lineno}: {name}: a list of numbers is allowed")
            return values
    raise InputError(f"{path}: no list {name!r}")


def by_our_law(angles: FloatArray, law: str = "stronge") -> FloatArray:
    """Ratios e_t of impacts by a law of one contact, of a sphere of 1 kg and unit speed; coordinates (x, y, angle)."""
    theta = np.radians(angles)
    zeros, ones = np.zeros(len(theta)), np.ones(len(theta))
    before = np.stack([np.sin(theta), -np.cos(theta), zeros], axis=1)
    normal, tangents = np.stack([zeros, ones, zeros], axis=1), np.stack([ones, zeros, RADIUS_M * ones], axis=1)[:, None]
    M = np.diag([1.0, 1.0, 0.4 * RADIUS_M**2])
    ratio = ELASTIC.compliance_ratio if law == "compliant" else 0.0
    after = predicted(MeasuredImpacts(M, normal, tangents, before, before, (2,), compliance_ratio=ratio), law, MU, E)
    return np.asarray(after[:, 0] / before[:, 0])


def in_closed_form(angles: FloatArray) -> FloatArray:
    """The same: sliding all along if tan(theta) > 3.5 mu (1 + e), else rolling at the end, e_t = 5/7."""
    return np.maximum(1.0 - MU * (1.0 + E) / np.tan(np.radians(angles)), 1.0 - 1.0 / _ROLLING)


def report(folder: Path, stage: Progress) -> GroupReport:
    """Errors of the laws where the sphere slides all along, and below.

    Raises:
        InputError: The data cannot be read.
    """
    angles, measured, file_digest = read(folder)
    stage("measured-sphere")
    by_law, closed = {law: by_our_law(angles, law) for law in LAWS}, in_closed_form(angles)
    limit = float(np.degrees(np.arctan(_ROLLING * MU * (1.0 + E))))
    below, small = angles <= limit, angles < _NEARLY_NORMAL_DEG
    parts = {
        f"sliding, above {limit:.1f} deg": ~below,
        f"{_NEARLY_NORMAL_DEG:g} to {limit:.1f} deg": below & ~small,
        f"below {_NEARLY_NORMAL_DEG:g} deg": small,
    }
    error = {law: {name: _rms((ours - measured)[which]) for name, which in parts.items()} for law, ours in by_law.items()}
    rows = [
        (
            name,
            str(int(which.sum())),
            f"{_reversed_slip(measured[which]).max():.2f}",
            *(f"{of_law[name]:.4f}" for of_law in error.values()),
            *(f"{_reversed_slip(ours[which]).max():.2f}" for ours in by_law.values()),
        )
        for name, which in parts.items()
        if which.any()
    ]
    errors = (f"rms of e_t, `{law}`" for law in LAWS)
    slips = (f"reversed slip, `{law}`" for law in LAWS)
    head = ("impacts", "number", "reversed slip, measured, largest", *errors, *slips)
    difference = float(np.abs(by_law["stronge"] - closed).max())
    note = (
        f"Largest difference between `stronge` and its closed form: {difference:.0e} (allowed {_ALLOWED:.0e})."
        f" `compliant` with k_t / k_n = {1.0 / ELASTIC.compliance_ratio:.3f} from the elastic constants; nothing is fitted."
    )
    # The numbers that were read, not the script: its other lines have changed from version to version.
    versions = other_versions(SOURCE, {_FILE: digest(np.stack([angles, measured]).astype("<f8").tobytes())})
    failure = f"the law differs from its closed form by {difference:.1e}, more than {_ALLOWED:.0e}"
    failures = (failure,) if difference > _ALLOWED else ()
    fine = np.linspace(1.0, 70.0, 140)
    curves = {"angle": angles, "measured": measured, "fine": fine, "computed": in_closed_form(fine)}
    curves["compliant"] = by_our_law(fine, "compliant")
    table = ReportTable("Ratio e_t of tangential speeds, after over before", head, tuple(rows), note)
    slides, between, _ = parts
    may = (
        "Where spheres slide all along, Coulomb's law with the published mu and e gives e_t to"
        f" {error['stronge'][slides]:.4f} (rms).",
        f"At {between}, where measured slip reverses, tangential compliance from elastic constants alone gives e_t to"
        f" {error['compliant'][between]:.4f}, and laws without it to {error['stronge'][between]:.4f}.",
    )
    may_not = (
        f"That laws without tangential compliance describe steeper impacts: measured slip reverses by up to"
        f" {_reversed_slip(measured).max():.2f}, and these laws end at rolling, 0.",
        f"That compliance explains what is nearly normal, below {_NEARLY_NORMAL_DEG:g} deg: its error is larger there.",
        "Anything about the rotation: the tabulated angular velocities are not used.",
    )
    return GroupReport({_FILE: file_digest}, versions, (), failures, (table,), may, may_not, curves)


def _rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan")


def _reversed_slip(ratios: FloatArray) -> FloatArray:
    """Slip after the impact over that before, with the other sign: negative if the sphere still slides, 0 if it rolls."""
    return _ROLLING * (1.0 - ratios) - 1.0
