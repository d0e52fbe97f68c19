"""A random scene on pieces against the same body on the whole box, and on the same pieces once more cut.

Some motions amplify rounding beyond any tolerance: the contact point of a nearly level cylinder rolls round its rim at
200 m/s, and each of a hundred impacts adds its share. Where pieces differ, the run on the whole box is made again from
starts moved by 3e-16 m: what differs as much there by the same event or row is of the motion, not of pieces.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.replay import explain, replay_log
from ffsm_mj.replay.truncation import AnalysisLimits
from ffsm_mj.tolerances import EPSILON
from tests.contact.unions.drawing import draw
from tests.contact.unions.scenes import Difference, differences, text_of
from tests.random_scenes.dice import Dice
from tests.random_scenes.judge import replay_faults
from tests.replays import assert_replayed

OF_CUTS, OF_ORDER = 1e-9, 1e-12
"""Tolerances of what differs from the run on the whole box, and from that on other pieces of the same planes.

Planes of pieces are those of the file, sums of sizes and places with an error of 1e-17 m. An impact amplifies it by the
lever arm over the gap at which two of its contacts are told apart; a bounce or so passes it on.
"""
MOVED, SHARE = 3e-16, 2.0
"""Move of a start, m: sums of sizes and places, and of poses that turn, differ by a few roundings of 1e-16 m. Differences of
pieces are those of the motion up to so many times what such moves make: a growing error is random, within factors."""
_MOST_LINES = 10


@dataclass
class Verdict:
    """What became of a seed.

    Attributes:
        name: What the scene is.
        faults: What is wrong on pieces; empty if nothing is.
        of_whole: What is wrong on the whole box, or as large if its start moves by rounding, if anything is wrong on pieces:
            it is no matter of unions.
        text: The files of the scene on pieces.
    """

    name: str
    faults: list[str] = field(default_factory=list)
    of_whole: list[str] = field(default_factory=list)
    text: str = ""

    def __str__(self) -> str:
        return "\n  ".join((self.name, *self.of_whole, *self.faults))


def wrong(run: Any) -> list[str]:
    """Checks of a run that fail, other than by truncation of its steps alone, and what its log replay says differently."""
    found = [] if run.outcome == "completed" else [f"{run.outcome}: {run.message}"]
    again = replay_log(run.log)
    found += replay_faults(again)
    for what, checks in (("run", all_checks(run)), ("replay", again.checks())):
        passes = all(check.passes for check in checks)
        for check in () if passes else explain(run, checks, limits=AnalysisLimits()).checks:
            if not (check.passes or check.fails_by_truncation):
                size = f"{check.residual:.1e} of {check.tolerance:.1e} {check.unit}, at {check.time_s:g} s"
                found.append(f"{what}: {check.name} of {check.subsystem} ({size})")
    return found


def sound(run: Any) -> Any:
    """A run that ran to its end, whose checks pass, and whose log replay agrees, for those tests that are replayed."""
    faults = [f"{run.outcome}: {run.message}"] if run.outcome != "completed" else []
    faults += [f"{check.name} of {check.subsystem}: {check.residual:.1e}" for check in all_checks(run) if not check.passes]
    assert not faults, "\n".join(faults)
    assert_replayed(run)
    return run


def judge(seed: int) -> Verdict:
    """Run the scene of a seed on the whole box, on its pieces and on other pieces."""
    drawn = draw(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = drawn.on_whole(folder / "whole"), drawn.on_pieces(folder / "pieces"), drawn.on_other_pieces(folder / "other")
        whole, pieces, other = map(ffsm_mj.run, paths)
        found = wrong(pieces)
        # A whole box on which the run ends early or fails a check says the same on pieces, and nothing of them.
        of_whole = [f"whole: {fault}" for fault in wrong(whole)] if found else []
        faults = [f"pieces: {fault}" for fault in found if f"whole: {fault}" not in of_whole]
        of_cuts = [*differences(whole, pieces, OF_CUTS, most=None)]
        # An impact divides velocities by small levers: each may add as much as all sums in another order differ by.
        allowed = OF_ORDER * (1 + len(pieces.impacts)) if len(drawn.pieces) > 1 else OF_CUTS
        of_order = [*differences(pieces, other, allowed, most=None)]
        if of_cuts or of_order:
            lines = [*(f"pieces, not whole: {line}" for line in of_cuts), *(f"other pieces: {line}" for line in of_order)]
            if _beyond_motion([*of_cuts, *of_order], whole, paths[0]):
                faults += lines[:_MOST_LINES]
            else:
                of_whole += [f"as if the start moves by rounding: {line}" for line in lines[:_MOST_LINES]]
        return Verdict(drawn.name, faults, of_whole, text_of(paths[1]))


def _moved(path: Path) -> Iterable[Any]:
    """Runs of a scene whose body starts beside, above or below its place by rounding, and then turned by it too."""
    text, dice = path.read_text(), Dice(0, "moves of a start")
    moves = [MOVED * sign * way for way, sign in product(np.eye(3, 7), (1.0, -1.0))]
    # Along the axes of the world a body may be moved as a whole floor is, by as much at all of its corners.
    moves += [np.array([*(MOVED * np.array(dice.direction())), *(EPSILON / 2.0 * dice.rng.normal(size=4))]) for _ in moves]
    for move in moves:
        scene = json.loads(text)
        joints = scene["initial"]["joints"]["free"]
        joints[:] = (np.array(joints) + move).tolist()
        beside = path.with_name("moved.yaml")
        beside.write_text(json.dumps(scene))
        yield ffsm_mj.run(beside)


def _beyond_motion(found: list[Difference], whole: Any, path: Path) -> list[Difference]:
    """What differs by more than it has by then in any run from a start moved by rounding."""
    for again in _moved(path):
        moved = [*differences(whole, again, 0.0, most=None)]
        found = [
            one
            for one in found
            if not any(of.what == one.what and of.place <= one.place and one.size <= SHARE * of.size for of in moved)
        ]
        if not found:
            break
    return found
