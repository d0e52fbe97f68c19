"""``measured-ellipse``: 1718 planar impacts of an ellipse, one law with one (mu, e), and the sign of their tangents."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.errors import InputError
from ffsm_mj.identification.fit import LawFit, fit, median_interval, predicted, split
from ffsm_mj.identification.impacts import (
    AS_RECORDED,
    MeasuredImpacts,
    MomentBalance,
    frame_of,
    frame_test,
    least_errors,
    moment_balance,
)
from ffsm_mj.report.markdown import percent
from ffsm_mj.validation.measured.source import DataSource, GroupReport, Progress, ReportTable, digest, other_versions, shown

_DATA, _MODELS = "processed_data/data_ellipse.mat", "processed_data/v_models.mat"
SOURCE = DataSource(
    "mcubelab/planar-impact-dataset",
    "f24a7e3",
    "none stated",
    {
        _DATA: "06ecb1642369b0e013f6f8ba7761797529c3de5e8d70d913722b118572afb169",
        _MODELS: "22ebce5783dbb4024e34d2bba05c1c08a30f29cf2473c6dc80a152bd77a677f6",
    },
    "N. Fazeli, MCube Lab, MIT; Fazeli, Zapolsky, Drumwright & Rodriguez 2017, arXiv:1710.05947",
)
MASS_KG = 0.0364
GYRATION_M = 0.0192
"""Radius of gyration. That of a uniform ellipse is 21.5 mm, but the least error is smallest here, of 18.5 to 21.5 mm."""
_ARMS_M = (0.024, 0.036)
"""Distances of the contact point from the mass centre: the semi-axes are 25 and 35 mm, and rows scatter by 0.4 mm."""
_TRAIN = 400 / 1718
"""Share of the impacts that are fitted to; the others judge."""
_LAWS = ("stronge", "poisson")
_SYNTHETIC = (0.18, 0.59)
"""(mu, e) of synthetic impacts, near those of the fit."""
BOUND, CONE_BOUND = "bound of any law", "bound in the friction cone"
_GAIN = 1e-9
"""Relative gain of kinetic energy above rounding, of which a prediction has 1e-15."""


def read(folder: Path) -> tuple[MeasuredImpacts, dict[str, FloatArray], dict[str, str]]:
    """The impacts as published, velocities after them by the published models, and the SHA-256 of the files.

    Coordinates are (x, y, angle) of the mass centre.

    Raises:
        InputError: A file is missing, is no MATLAB file, or has other contents.
    """
    contents = {file: SOURCE.read(folder, file) for file in SOURCE.digests}
    data, models = (_matlab(contents[file], folder / file) for file in SOURCE.digests)
    path = folder / _DATA
    if "data" not in data or not isinstance(data["data"], dict):
        raise InputError(f"{path}: no struct 'data'; it has {_listed(data)}")
    fields = {name: _array(data["data"], name, width, path) for name, width in _FIELDS.items()}
    k = len(fields["states_i"])
    for name, array in fields.items():
        if len(array) != k:
            raise InputError(f"{path}: data.{name} has {len(array)} rows, data.states_i {k}: one row for each impact")
    _refuse_other_rows(fields["n"], fields["d"], path)
    velocities = _array(models, "v_models", 18, folder / _MODELS)
    if len(velocities) != k:
        raise InputError(
            f"{folder / _MODELS}: v_models has {len(velocities)} rows, {_DATA} {k} impacts: they are of different versions"
        )
    before, after = fields["states_i"][:, 3:], fields["states_f"][:, 3:]
    M = np.diag([MASS_KG, MASS_KG, MASS_KG * GYRATION_M**2])
    impacts = MeasuredImpacts(M, fields["n"], fields["d"][:, None], before, after, (2,))
    published = {f"published model {i + 1}": velocities[:, 3 * i : 3 * i + 3] for i in range(6)}
    return impacts, published, {file: digest(contents[file]) for file in SOURCE.digests}


_FIELDS = {"states_i": 6, "states_f": 6, "n": 3, "d": 3}
"""Fields of the struct and their columns."""


def _refuse_other_rows(normal: FloatArray, tangents: FloatArray, path: Path) -> None:
    """Refuse contact rows that are not n = (0, 1, c), d = (1, 0, h) with lever arms of this ellipse in m.

    Raises:
        InputError: One is another; that of other units is too.
    """
    arms = np.hypot(normal[:, 2], tangents[:, 2])
    linear = np.hstack([normal[:, :2], tangents[:, :2]])
    bad = np.flatnonzero(np.any(linear != (0.0, 1.0, 1.0, 0.0), axis=1) | (arms < _ARMS_M[0]) | (arms > _ARMS_M[1]))
    if len(bad):
        row = bad[0]
        raise InputError(
            f"{path}: row {row + 1}: n = {normal[row].tolist()}, d = {tangents[row].tolist()}; allowed are (0, 1, c) and"
            f" (1, 0, h) with hypot(c, h) of {_ARMS_M[0]} to {_ARMS_M[1]} m"
        )


def _matlab(data: bytes, path: Path) -> dict[str, object]:
    """Variables of a MATLAB file.

    Raises:
        InputError: It is none.
    """
    from scipy.io import loadmat

    try:
        return dict(loadmat(io.BytesIO(data), simplify_cells=True))
    except Exception as error:  # noqa: BLE001 (scipy's reader fails in any way on a file of another kind)
        raise InputError(f"{path}: not a MATLAB file that can be read ({error})") from None


def _array(variables: dict[str, object], name: str, width: int, path: Path) -> FloatArray:
    """A variable with a row for each impact.

    Raises:
        InputError: It is missing, of another shape, or not of finite numbers.
    """
    if name not in variables:
        raise InputError(f"{path}: no variable {name!r}; it has {_listed(variables)}")
    array = np.atleast_2d(np.asarray(variables[name]))
    if array.dtype.kind not in "fiu" or array.ndim != 2 or array.shape[1] != width:
        raise InputError(f"{path}: {name} is {array.shape} of {array.dtype}; {width} columns of numbers are allowed")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise InputError(f"{path}: {name}, row {bad[0] + 1}: not finite")
    return array.astype(np.float64)


def _listed(variables: dict[str, object]) -> str:
    return ", ".join(name for name in variables if not name.startswith("__")) or "no variable"


def report(folder: Path, stage: Progress) -> GroupReport:
    """Sign test, fits, bounds and published models.

    Raises:
        InputError: The data cannot be read.
    """
    recorded, published, digests = read(folder)
    stage("measured-ellipse: fits")
    balances = frame_test(recorded)
    frame = max(balances, key=lambda name: balances[name].r_squared)
    impacts = frame_of(recorded, frame)
    train, test = split(len(impacts), round(_TRAIN * len(impacts)))
    synthetic = replace(impacts, after=predicted(impacts, "stronge", *_SYNTHETIC))
    fits = [fit(impacts.select(train), _LAWS[0])]
    fits += [fit(impacts.select(train), law, (fits[0].mu.value, fits[0].e.value)) for law in _LAWS[1:]]
    refit = fit(recorded.select(train), _LAWS[0])
    judged = impacts.select(test)
    as_published = recorded.select(test)
    errors = {
        BOUND: least_errors(judged).errors,
        CONE_BOUND: least_errors(judged, fits[0].mu.value).errors,
        **{one.law: judged.errors(_by_fit(judged, one)) for one in fits},
    }
    there = {
        **{name: as_published.errors(velocities[test]) for name, velocities in published.items()},
        f"{refit.law}, refitted with the published tangents": as_published.errors(_by_fit(as_published, refit)),
        f"{BOUND}, with the published tangents": least_errors(as_published).errors,
    }
    tables = (
        _sign_test(recorded, balances, synthetic, test),
        _laws(judged, fits, errors),
        ReportTable("Published models, with the tangents as published", ("model", "median E"), _medians(there)),
    )
    notices = []
    if frame != AS_RECORDED:
        notices.append(
            f"{_DATA}: the momenta do not obey the published tangents d: R^2 of the moment balance is"
            f" {balances[AS_RECORDED].r_squared:.3f}, and {balances[frame].r_squared:.3f} with {frame}, as used here"
        )
    claims = _claims(fits[0], errors, there, (len(train), len(test)))
    versions, failures = other_versions(SOURCE, digests), _failures(judged, fits)
    return GroupReport(digests, versions, tuple(notices), failures, tables, *claims, errors)


def _failures(impacts: MeasuredImpacts, fits: Sequence[LawFit]) -> tuple[str, ...]:
    """Laws that gain energy in some impact, which none may."""
    gains = {one.law: impacts.energy_ratios(_by_fit(impacts, one)).max() for one in fits}
    return tuple(f"{law} gains energy: ratio {ratio:.3g}" for law, ratio in gains.items() if ratio > 1.0 + _GAIN)


def _by_fit(impacts: MeasuredImpacts, fitted: LawFit) -> FloatArray:
    return predicted(impacts, fitted.law, fitted.mu.value, fitted.e.value)


def _medians(errors: Mapping[str, FloatArray]) -> tuple[tuple[str, ...], ...]:
    return tuple((name, shown(median_interval(one), 4)) for name, one in errors.items())


def _claims(
    fitted: LawFit, errors: Mapping[str, FloatArray], there: Mapping[str, FloatArray], numbers: tuple[int, int]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the numbers support, and what they do not."""
    law, bound, cone = (percent(float(np.median(errors[name]))) for name in (fitted.law, BOUND, CONE_BOUND))
    *models, refit, floor = (float(np.median(one)) for one in there.values())
    may = (
        f"With the tangents that the momenta obey, one pair (mu, e) of `{fitted.law}`, fitted to {numbers[0]} impacts,"
        f" predicts {numbers[1]} others to {law} in the norm of the kinetic energy (median). No impact through the contact"
        f" point comes nearer than {bound}, and none in the friction cone than {cone}.",
    )
    may_not = (
        f"That our laws are better than the published models by the ratio of the errors. Those score {min(models):.3f} to"
        f" {max(models):.3f} with the published tangents; with these, our refitted law scores {refit:.3f} and the bound of"
        f" any law is {floor:.3f}. The gap is the sign of the tangents, not the law: exact impacts of ours with the other"
        " sign have as high a bound.",
        "That the publications are wrong: only the files were examined. Which of the horizontal and the angular velocity is"
        " reversed cannot be told from them; the scores are the same.",
    )
    return may, may_not


def _sign_test(
    recorded: MeasuredImpacts, balances: Mapping[str, MomentBalance], synthetic: MeasuredImpacts, test: IntArray
) -> ReportTable:
    """What the momenta say of each frame; the same of exact impacts of ours, in the frame that they obey and its mirror."""
    mu, e = _SYNTHETIC
    frames = {
        **{name: (frame_of(recorded, name), balance) for name, balance in balances.items()},
        f"exact impacts of ours, mu {mu}, e {e}": (synthetic, moment_balance(synthetic)),
    }
    reversed_tangents = synthetic.with_reversed_tangents()
    frames["the same, tangents reversed"] = reversed_tangents, moment_balance(reversed_tangents)
    rows = []
    for name, (impacts, balance) in frames.items():
        bound = float(np.median(least_errors(impacts.select(test)).errors))
        miss, far = np.quantile(balance.misses, (0.5, 0.9)) * 1e3
        rows.append(
            (
                name,
                f"{balance.r_squared:.3f}",
                f"{miss:.2f}",
                f"{far:.2f}",
                percent(balance.along_slip),
                percent(balance.slip_grows),
                f"{bound:.4f}" if bound > 1e-12 else f"{bound:.0e}",
            )
        )
    head = ("frame", "R^2", "miss, median, mm", "miss, 90 %, mm", "friction along slip", "slip grows", "bound, median E")
    return ReportTable("Sign test", head, tuple(rows))


def _laws(impacts: MeasuredImpacts, fits: Sequence[LawFit], errors: Mapping[str, FloatArray]) -> ReportTable:
    """The fitted laws on impacts that they were not fitted to, the measured energies, and the bounds of any law."""
    rows = [
        (name, "", "", median, "", "") for name, median in _medians({name: errors[name] for name in (BOUND, CONE_BOUND)})
    ]
    rows.append(("measured", "", "", "", *_energies(impacts, impacts.after)))
    for one in fits:
        median = shown(median_interval(errors[one.law]), 4)
        rows.append((one.law, shown(one.mu, 4), shown(one.e, 4), median, *_energies(impacts, _by_fit(impacts, one))))
    head = ("law", "mu", "e", "median E", "energy ratio, median", "impacts that gain energy")
    return ReportTable("Laws, and what no law can beat", head, tuple(rows))


def _energies(impacts: MeasuredImpacts, velocities: FloatArray) -> tuple[str, str]:
    """Median ratio of the kinetic energies after and before, and how many are above 1."""
    ratios = impacts.energy_ratios(velocities)
    return f"{np.median(ratios):.3f}", str(int(np.sum(ratios > 1.0 + _GAIN)))
