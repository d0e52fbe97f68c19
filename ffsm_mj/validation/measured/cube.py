"""``measured-cube``: tosses of a cube simulated to their end, with (mu, e) fitted on some and judged on others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ffsm_mj.all_cores import on_all_cores
from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError
from ffsm_mj.identification.fit import Interval, mean_interval, median_interval
from ffsm_mj.report.markdown import percent
from ffsm_mj.validation.measured.source import DataSource, GroupReport, Progress, ReportTable, digest, other_versions, shown
from ffsm_mj.validation.measured.tosses import LEAST_FREE_FRAMES, RATE_HZ, SCALE, Toss, read_toss
from ffsm_mj.validation.measured.tossing import GRAVITY, TossMotion, TossTask, errors, simulate, simulate_soft

_FOLDER = "data/tosses_processed"
_FILES = f"{_FOLDER}/*.pt"
SOURCE = DataSource(
    "DAIRLab/contact-nets",
    "c3dc21c",
    "BSD-3-Clause",
    {_FILES: "12c645b80fa9e3f68523768b785dae7b31f40c9eaba19370cb8dcd6873f015f1"},
    "Pfrommer, Halm & Posa 2020, ContactNets, arXiv:2009.11193",
)
_SEED, _POOL, _TRAIN = 7, 40 / 570, 24
"""Seed of the order of tosses, share of those that are never judged by, and how many of these are fitted to."""
_JUDGED = {False: (60, 30), True: (180, 90)}
"""Tosses simulated from their first frame, and from the end of their flight; without and with --long."""
_START = (0.18, 0.25)
"""(mu, e) where the search begins."""
_MU, _E = (0.12, 0.15, 0.18, 0.2, 0.22), (0.0, 0.125, 0.25, 0.4)
"""Grid of the search: one after the other, as simulations of bounces are no smooth function of either."""
_FRAMES = (7, 15, 30)
"""Frames after the end of the flight at which errors are compared: a few impacts, some, and the end of bouncing."""


OURS, SOFT_NAME = "ours", "MuJoCo, as others fitted it"


def read(folder: Path) -> tuple[list[Toss], dict[str, str]]:
    """The tosses by their numbers, and one SHA-256 of their files.

    Raises:
        InputError: There are none, or a file is no toss.
    """
    if not (folder / _FOLDER).is_dir():
        raise InputError(f"{folder / _FOLDER}: no such folder; --data takes a copy of {SOURCE.named}")
    numbers = sorted(int(path.stem) for path in (folder / _FOLDER).glob("*.pt") if path.stem.isdecimal())
    if not numbers:
        raise InputError(f"{folder / _FOLDER}: no file NUMBER.pt; --data takes a copy of {SOURCE.named}")
    contents = {number: SOURCE.read(folder, f"{_FOLDER}/{number}.pt") for number in numbers}
    tosses = [read_toss(data, f"{folder / _FOLDER}/{number}.pt") for number, data in contents.items()]
    every = "".join(f"{number} {digest(data)}\n" for number, data in contents.items())
    return tosses, {_FILES: digest(every.encode())}


@dataclass(frozen=True)
class _Search:
    """A grid search for (mu, e) on training tosses.

    Attributes:
        mu: The best of the grid, with the interval of its choice on resampled tosses.
        e: Likewise.
        scores: Median error of position by (mu, e), widths.
    """

    mu: Interval
    e: Interval
    scores: Mapping[tuple[float, float], float]


def report(folder: Path, stage: Progress, *, long: bool = False) -> GroupReport:
    """Free fall, search for (mu, e), and errors of tosses that were not searched.

    Raises:
        InputError: The data cannot be read.
    """
    tosses, digests = read(folder)
    order = np.random.default_rng(_SEED).permutation(len(tosses))
    pool = round(_POOL * len(tosses))
    train = [tosses[i] for i in order[:pool] if tosses[i].free_frames >= LEAST_FREE_FRAMES][:_TRAIN]
    test = [tosses[i] for i in order[pool:]]
    whole, tracked = (test[:k] for k in _JUDGED[long])
    tracked = [toss for toss in tracked if toss.free_frames >= LEAST_FREE_FRAMES]
    search = _search(train, stage)
    mu, e = search.mu.value, search.e.value
    tasks = [TossTask(toss.first_state, len(toss), mu, e) for toss in whole]
    tasks += [_from_free_flight(toss, mu, e) for toss in tracked]
    motions = on_all_cores(simulate, tasks, stage("measured-cube: judged", len(tasks)))
    first, rest = tasks[: len(whole)], tasks[len(whole) :]
    from_first = {OURS: motions[: len(whole)], SOFT_NAME: [simulate_soft(task, scale=1.0) for task in first]}
    from_free_flight = {OURS: motions[len(whole) :], SOFT_NAME: [simulate_soft(task, scale=SCALE) for task in rest]}
    means = {name: _means(whole, group) for name, group in from_first.items()}
    tables = (
        _fall(tosses),
        _searched(search, len(train)),
        _from_first_frame(means, [motion.impacts for motion in from_first[OURS]]),
        _from_end_of_free_flight(tracked, from_free_flight),
    )
    failures = tuple(
        f"run {i} of {len(motions)}: check {failure} fails" for i, one in enumerate(motions, 1) for failure in one.failures
    )
    versions, curves = other_versions(SOURCE, digests), _curves(tracked, from_free_flight)
    return GroupReport(digests, versions, (), failures, tables, *_claims(means, search), curves)


def _from_free_flight(toss: Toss, mu: float, e: float) -> TossTask:
    return TossTask(toss.free_flight_state(SCALE * GRAVITY), len(toss) - toss.free_frames + 1, mu, e)


def _search(train: Sequence[Toss], stage: Progress) -> _Search:
    """First mu, then e, over its grid: least is the median over tosses of the mean error of position over frames."""
    if not train:  # nothing to search on: the values where it would begin, and any of the grid
        mu, e = (Interval(start, grid[0], grid[-1]) for start, grid in zip(_START, (_MU, _E), strict=True))
        return _Search(mu, e, {})
    scores = dict[tuple[float, float], FloatArray]()

    def best(points: Sequence[tuple[float, float]], axis: int) -> Interval:
        new = [point for point in points if point not in scores]
        tasks = [_from_free_flight(toss, *point) for point in new for toss in train]
        motions = iter(on_all_cores(simulate, tasks, stage(f"measured-cube: {('mu', 'e')[axis]}", len(tasks))))
        for point in new:
            scores[point] = np.array([errors(next(motions), toss, toss.free_frames - 1)[0].mean() for toss in train])
        table = np.array([scores[point] for point in points])
        random = np.random.default_rng(0)
        resamples = random.integers(len(train), size=(2000, len(train)))
        choices = np.array([points[np.median(table[:, which], axis=1).argmin()][axis] for which in resamples])
        return Interval.of(points[np.median(table, axis=1).argmin()][axis], choices)

    mu = best([(mu, _START[1]) for mu in _MU], 0)
    e = best([(mu.value, e) for e in _E], 1)
    return _Search(mu, e, {point: float(np.median(score)) for point, score in scores.items()})


def _fall(tosses: Sequence[Toss]) -> ReportTable:
    """The metre of the files: their free fall, and the height at which the cube lies."""
    falls = np.array([toss.gravity() for toss in tosses if toss.free_frames > LEAST_FREE_FRAMES])
    heights = np.array([1e3 * toss.positions[-1, 2] for toss in tosses])
    lengths = [len(toss) for toss in tosses]
    rows = (
        ("tosses", str(len(tosses))),
        ("frames at 148 Hz, least and most", f"{min(lengths)}, {max(lengths)}"),
        ("free fall, median, m/s^2", shown(median_interval(falls), 3) if len(falls) else "no flight long enough"),
        ("height of the centre at the end, median, mm", f"{np.median(heights):.2f}"),
    )
    note = (
        f"Positions are in a metre that is short: the half width and g of the simulations are {SCALE} of the nominal ones."
    )
    return ReportTable("Tosses as recorded", ("quantity", "value"), rows, note)


def _searched(search: _Search, tosses: int) -> ReportTable:
    rows = [
        (f"{mu:g}", f"{e:g}", f"{score:.3f}", "best" if (mu, e) == (search.mu.value, search.e.value) else "")
        for (mu, e), score in search.scores.items()
    ]
    note = (
        f"On {tosses} tosses: mu {search.mu.value:g} [{search.mu.low:g}, {search.mu.high:g}],"
        f" e {search.e.value:g} [{search.e.low:g}, {search.e.high:g}]: the choices of 95 % of resamples, on this grid."
    )
    return ReportTable("Search for (mu, e)", ("mu", "e", "error of position, median, widths", ""), tuple(rows), note)


def _means(tosses: Sequence[Toss], motions: Sequence[TossMotion]) -> tuple[Interval, Interval]:
    """Errors of position, widths, and of rotation, deg, of whole tosses: means over frames, then tosses."""
    both = [errors(motion, toss, 0) for motion, toss in zip(motions, tosses, strict=True)]
    distances, angles = (np.array([part.mean() for part in parts]) for parts in zip(*both, strict=True))
    return mean_interval(distances), mean_interval(angles)


def _from_first_frame(means: Mapping[str, tuple[Interval, Interval]], impacts: Sequence[int]) -> ReportTable:
    """Whole tosses from the first frame as tabulated, as Acosta, Yang & Posa compare them."""
    rows = tuple((name, shown(distance, 3), shown(angle, 1)) for name, (distance, angle) in means.items())
    note = (
        f"{len(impacts)} tosses, with {np.mean(impacts):.0f} impacts of ours on average."
        " MuJoCo's contact was fitted by this measure."
    )
    return ReportTable("From the first frame, means", ("engine", "error of position, widths", "rotation, deg"), rows, note)


def _claims(means: Mapping[str, tuple[Interval, Interval]], search: _Search) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the numbers support, and what they do not."""
    (ours, turn), (soft, soft_turn) = means[OURS], means[SOFT_NAME]
    apart = ours.high < soft.low
    may = (
        f"From the first frame as tabulated, one rule with mu {search.mu.value:g} and e {search.e.value:g} has an error of"
        f" position of {percent(ours.value / soft.value)} of that of MuJoCo's contact as others fitted it to these tosses.",
    )
    turns = (
        "That rotations are predicted better or worse than by that contact: the intervals overlap, so that no difference is"
        " shown."
        if turn.low <= soft_turn.high and soft_turn.low <= turn.high
        else "That rotations compare as positions do."
    )
    others = (
        "That errors of rotation come from the law of impact: they are there after the first impacts already, in both"
        " engines. Rounded corners, the place of the tag and the moments of inertia come before the law.",
        "Anything about the end of a toss as a test of impacts: it tests sliding and rocking.",
    )
    return (may if apart else ()), (turns, *others)


def _from_end_of_free_flight(tosses: Sequence[Toss], engines: Mapping[str, Sequence[TossMotion]]) -> ReportTable:
    """Errors at frames after the last one of free flight, medians over tosses."""
    head = ("engine", *(f"{1e3 * frame / RATE_HZ:.0f} ms" for frame in _FRAMES), "end", "final face as measured")
    rows = []
    for name, motions in engines.items():
        both = [errors(motion, toss, toss.free_frames - 1) for motion, toss in zip(motions, tosses, strict=True)]
        cells = []
        for frame in (*_FRAMES, -1):
            distances, angles = (_median_at(frame, parts) for parts in zip(*both, strict=True))
            cells.append(f"{distances:.3f}; {angles:.1f}")
        faces = [_face(motion) == _face(toss) for motion, toss in zip(motions, tosses, strict=True)]
        rows.append((name, *cells, percent(float(np.mean(faces)))))
    note = f"{len(tosses)} tosses; errors of position in widths, and of rotation in deg; medians."
    return ReportTable("From the end of free flight", head, tuple(rows), note)


def _median_at(frame: int, parts: Sequence[FloatArray]) -> float:
    """Median over tosses of the error at a frame, at the last one of shorter tosses."""
    return float(np.median([part[min(frame, len(part) - 1)] for part in parts]))


def _face(motion: TossMotion | Toss) -> int:
    """The face of the cube that is up at the end: 1 to 3 by its axis, negative on the other side."""
    up = motion.rotations[-1].inv().apply((0.0, 0.0, 1.0))
    axis = int(np.argmax(np.abs(up)))
    return int(np.sign(up[axis])) * (axis + 1)


def _curves(tosses: Sequence[Toss], engines: Mapping[str, Sequence[TossMotion]]) -> dict[str, FloatArray]:
    """Median errors of position by time after the flight."""
    frames = range(45)
    curves = {"time, ms": np.array(frames) * 1e3 / RATE_HZ}
    for name, motions in engines.items():
        parts = [errors(motion, toss, toss.free_frames - 1)[0] for motion, toss in zip(motions, tosses, strict=True)]
        curves[name] = np.array([_median_at(frame, parts) for frame in frames])
    return curves
