"""Output of a fit: text for a terminal, lines for the scenario, the figure, and the files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ffsm_mj.analysis.tables import Table
from ffsm_mj.arrays import FloatArray
from ffsm_mj.identification.fit import Interval
from ffsm_mj.identification.frames import RECORDED
from ffsm_mj.identification.rule_fits import NEEDED, SLIDING, Fits, RuleFit
from ffsm_mj.report.export import to_arrow, write_arrow
from ffsm_mj.report.output_place import new_file, usable_folder
from ffsm_mj.report.plots.style import BLACK, BLUE, VERMILION, WIDTH_IN, plain, publication, write
from ffsm_mj.report.terminal import table

NAME = "fit"
_DOUBTFUL = 0.5
"""R^2 of the moment balance below which half of the changes of angular momentum are from something else."""
_FALL = 0.01
"""Difference of free fall from gravity from which on a scale is wrong: air takes less from what is tossed indoors."""
_COLUMNS = {
    "rule": ("", "contact rule"),
    "recording": ("", "file, and run of it"),
    "time_s": ("s", "instant of the impact since the first row of the file"),
    "pair": ("", "contact pair"),
    "point_x_m": ("m", "contact point, world axes"),
    "point_y_m": ("m", "likewise, y"),
    "point_z_m": ("m", "likewise, z"),
    "gap_m": ("m", "gap of the pair at the recorded pose"),
    "approach_m_s": ("m/s", "normal speed before, measured"),
    "separation_m_s": ("m/s", "normal speed after, measured"),
    "separation_fit_m_s": ("m/s", "the same by the fit"),
    "slip_before_m_s": ("m/s", "tangential speed before, measured"),
    "slip_after_m_s": ("m/s", "tangential speed after, measured"),
    "slip_after_fit_m_s": ("m/s", "the same by the fit"),
    "impulse_N_s": ("N s", "normal impulse that explains the measured velocities best"),
    "friction_impulse_N_s": ("N s", "size of its tangential part"),
    "error": ("", "|v_fit - v_after| / |v_before| in the norm of the kinetic energy"),
    "least_error": ("", "the least that any impulse through the contact point has"),
}
"""Unit and meaning of the columns of the table of impacts."""


def lines(fits: Fits) -> Iterator[str]:
    """Noise, results of each rule, the test of the frame, and what was left out."""
    if fits.noise:
        yield "noise of the recording: " + ", ".join(f"{name} {value:.2g}" for name, value in fits.noise.items())
    if fits.fall is not None:
        doubt = "; lengths or times of the recording are not those of the scenario" if abs(fits.fall - 1.0) > _FALL else ""
        yield f"free fall in the flights: {fits.fall:.4f} times the gravity of the scenario{doubt}"
    head = ("rule", "impacts", "sliding", "e", "95 %", "mu", "95 %", "median\nerror", "least\nerror")
    yield table(head, map(_row, fits.rules))
    yield f"law {fits.law}; errors of velocities in the norm of the kinetic energy, relative to those before"
    for one in fits.rules:
        name = one.of.rule.name
        if one.law is None:
            yield f"{name}: too few impacts, {NEEDED} are needed"
        elif not one.is_mu_known:
            yield (
                f"{name}: mu is not known: {one.sliding} impacts slide to the end, {SLIDING} are needed; "
                "throw at a flatter angle or with more spin"
            )
        if RECORDED in one.r_squared:
            recorded = one.r_squared[RECORDED]
            others = [f"{value:.2g} {frame}" for frame, value in one.r_squared.items() if frame != RECORDED]
            doubt = "; check the order of quaternions, shapes, masses and units" if recorded < _DOUBTFUL else ""
            yield (
                f"{name}: frame: moments of the impulses against changes of angular momentum: R2 {recorded:.3g} {RECORDED}"
                f"{doubt} ({', '.join(others)})"
            )
    for reason, number in fits.left_out.items():
        yield f"left out: {number} x {reason}"


def _row(one: RuleFit) -> tuple[str, ...]:
    k = len(one.of.jumps)
    least = f"{np.median(one.least.errors):.3f}" if k else ""
    if one.law is None:
        return one.of.rule.name, str(k), "", "", "", "", "", "", least
    mu = (f"{one.law.mu.value:.4f}", _range(one.law.mu)) if one.is_mu_known else ("", "")
    error = f"{np.median(one.errors):.3f}"
    return one.of.rule.name, str(k), str(one.sliding), f"{one.law.e.value:.4f}", _range(one.law.e), *mu, error, least


def _range(interval: Interval) -> str:
    return f"{interval.low:.4f} to {interval.high:.4f}"


def rule_lines(fits: Fits) -> list[str]:
    """Lines for ``contacts.rules`` of the scenario: the rules that were fitted, with intervals as comments."""
    text = ["contacts:", "  rules:"]
    for one in fits.rules:
        if one.law is None:
            continue
        rule, e = one.of.rule, one.law.e
        mu = f", mu: {one.law.mu.value:.4g}" if one.is_mu_known else f", mu: {rule.mu:g}"
        said = f"mu {_range(one.law.mu)}" if one.is_mu_known else "mu is not from the fit"
        said += "; keep its key elastic" if rule.compliance_ratio else ""
        keys = f"between: [{', '.join(map(_word, rule.between))}], name: {_word(rule.name)}"
        text.append(
            f"    - {{{keys}, restitution: {e.value:.4g}{mu}}}  # {len(one.of.jumps)} impacts: e {_range(e)}, {said}"
        )
    return text


def _word(text: str) -> str:
    """A name as a YAML flow sequence takes it."""
    return text if text.replace("_", "").replace("-", "").replace("/", "").isalnum() else json.dumps(text)


def impact_table(fits: Fits) -> Table:
    """All impacts with their residuals."""
    rows = [row for one in fits.rules for row in _rows(one)]
    columns = {name: np.array([row[k] for row in rows]) for k, name in enumerate(_COLUMNS)}
    units, meanings = ({name: value[k] for name, value in _COLUMNS.items()} for k in (0, 1))
    return Table("impacts", columns, units, meanings)


def _rows(one: RuleFit) -> Iterator[tuple[Any, ...]]:
    impacts, p = one.of.impacts, one.least.impulses
    values = (
        -_normal(one, impacts.before),
        _normal(one, impacts.after),
        _normal(one, one.velocities),
        *(_slip(one, v) for v in (impacts.before, impacts.after, one.velocities)),
        p[:, 0],
        np.linalg.norm(p[:, 1:], axis=1),
        one.errors if one.law is not None else np.full(len(impacts), np.nan),
        one.least.errors,
    )
    for k, (jump, point) in enumerate(zip(one.of.jumps, one.of.points, strict=True)):
        place = (one.of.rule.name, jump.place, jump.time_s, point.pair, *point.position_m.tolist(), point.gap_m)
        yield (*place, *(float(column[k]) for column in values))


def _normal(one: RuleFit, velocities: FloatArray) -> FloatArray:
    """Normal velocities, m/s, (k,)."""
    return np.asarray(np.einsum("kj,kj->k", one.of.impacts.normal, velocities))


def _slip(one: RuleFit, velocities: FloatArray) -> FloatArray:
    """Tangential speeds, m/s, (k,)."""
    return np.asarray(np.linalg.norm(np.einsum("kij,kj->ki", one.of.impacts.tangents, velocities), axis=1))


def data(fits: Fits) -> dict[str, Any]:
    """The fits as plain data."""
    return {
        "law": fits.law,
        "noise": dict(fits.noise),
        "free_fall_ratio": fits.fall,
        "left_out": dict(fits.left_out),
        "rules": {one.of.rule.name: _data(one) for one in fits.rules},
    }


def _data(one: RuleFit) -> dict[str, Any]:
    fitted = {} if one.law is None else {"restitution": vars(one.law.e)}
    if one.law is not None and one.is_mu_known:
        fitted["mu"] = vars(one.law.mu)
    errors = {} if one.law is None else {"median_error": float(np.median(one.errors))}
    return {
        "impacts": len(one.of.jumps),
        "sliding": one.sliding,
        **fitted,
        **errors,
        "median_least_error": float(np.median(one.least.errors)) if len(one.of.jumps) else None,
        "moment_balance_r2": dict(one.r_squared),
    }


def draw(fits: Fits) -> Figure:
    """Draw measured against fitted velocities, and the residuals, a row for each fitted rule."""
    fitted = [one for one in fits.rules if one.law is not None]
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.36 * WIDTH_IN * len(fitted)), layout="constrained")
        for panels, one in zip(figure.subplots(len(fitted), 3, squeeze=False), fitted, strict=True):
            _rebound(panels[0], one)
            _friction(panels[1], one)
            _residuals(panels[2], one)
        handles = [handle for panel in figure.axes[:3] for handle in panel.get_legend_handles_labels()[0]]
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _rebound(axes: Axes, one: RuleFit) -> None:
    before = -_normal(one, one.of.impacts.before)
    axes.plot(before, _normal(one, one.of.impacts.after), "o", color=BLACK, markersize=3.0, label="measured")
    axes.plot(before, _normal(one, one.velocities), "x", color=VERMILION, markersize=4.0, label="fit")
    axes.set_xlabel("approach, m/s")
    axes.set_ylabel("separation, m/s")
    axes.set_title(plain(one.of.rule.name))


def _friction(axes: Axes, one: RuleFit) -> None:
    before = _slip(one, one.of.impacts.before)
    axes.plot(before, _slip(one, one.of.impacts.after), "o", color=BLACK, markersize=3.0)
    axes.plot(before, _slip(one, one.velocities), "x", color=VERMILION, markersize=4.0)
    axes.set_xlabel("slip before, m/s")
    axes.set_ylabel("slip after, m/s")
    assert one.law is not None
    axes.set_title(f"$e$ = {one.law.e.value:.3f}" + (rf", $\mu$ = {one.law.mu.value:.3f}" if one.is_mu_known else ""))


def _residuals(axes: Axes, one: RuleFit) -> None:
    order = np.argsort(one.errors)
    axes.plot(one.errors[order], "x", color=VERMILION, markersize=4.0)
    axes.plot(one.least.errors[order], "-", color=BLUE, label="least of any impulse")
    axes.set_xlabel("impact, by its error")
    axes.set_ylabel("error of the velocity")
    axes.set_ylim(bottom=0.0)


def save(fits: Fits, folder: Path) -> list[Path]:
    """Write a fit into a folder: ``fit.csv`` and ``.parquet`` with all impacts, ``fit.json``, ``fit.png`` and ``.svg``.

    Raises:
        InputError: The folder is not writable.
        OutputLostError: A file could not be written completely.
    """
    usable_folder(folder)
    files = [folder / f"{NAME}.{form}" for form in ("csv", "parquet")]
    for path in files:
        write_arrow(iter([to_arrow(impact_table(fits))]), path, path.suffix[1:])
    numbers = folder / f"{NAME}.json"
    with new_file(numbers) as place:
        place.write_text(json.dumps(data(fits), indent=2) + "\n", encoding="utf-8")
    return [*files, numbers, *write(draw(fits), folder, NAME)]
