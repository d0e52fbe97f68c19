"""Random pushes with friction: every check passes, energy grows by efforts alone, and the log says what its states say."""

from __future__ import annotations

import json

import numpy as np
import pytest

import ffsm_mj
from tests.contact_models.persistent import variants
from tests.contact_models.persistent.random_pushes import LAWS, drawn, quaternion
from tests.contact_models.persistent.test_random_pushes import wrong

ROUND = (0.01, 0.1, 0.3, 0.5, 0.7, 1.0, 1.5)


def rubbed(seed, folder):
    """A scene of random pushes with a coefficient of friction for each pair: a round number, or an odd one."""
    path = drawn(np.random.default_rng(seed), folder)
    scenario, rng = json.loads(path.read_text()), np.random.default_rng(seed + 10**6)
    for rule in scenario["contacts"]["rules"]:
        rule["mu"] = float(rng.choice(ROUND)) if rng.random() < 0.5 else float(rng.uniform(0, 1))
    path.write_text(json.dumps(scenario))
    return path


@pytest.mark.long(one_of=20)
@pytest.mark.parametrize("seed", [seed for seed in range(60) if seed not in (19, 53)])  # these take 7 s and more
def test_random_pushes_with_friction(tmp_path, seed):
    assert wrong(rubbed(seed, tmp_path)) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", range(300, 320))
def test_efforts_that_jump_at_every_tick(tmp_path, seed):
    assert wrong(variants.jumping(rubbed(seed, tmp_path), np.random.default_rng(seed))) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1, 3, 4, 5, 6, 7, 8, 9, 11, 12, 14, 16, 17, 18])  # the others take up to 40 s each
def test_turned_boosted_and_reordered_scenes_are_the_same(tmp_path, seed):
    """They differ by less than if a pad moves faster by 1e-9 m/s: ten times the gap rates that are left as drift."""
    rng = np.random.default_rng(seed)
    path = variants.jumping(rubbed(seed, tmp_path), rng)

    def states(change):
        changed = tmp_path / "changed.yaml"
        changed.write_text(json.dumps(change(variants.said_by(path))))
        return variants.seen_by_the_robot(ffsm_mj.run(changed, controllers=LAWS))

    turn, velocity, own = quaternion(rng), rng.uniform(-1, 1, 3), states(dict)
    others = [lambda said: variants.turned(said, turn), lambda said: variants.reordered(said, tmp_path)]
    if "wall" not in variants.said_by(path)["objects"]:
        others.append(lambda said: variants.boosted(said, velocity))
    allowed = np.abs(states(lambda said: variants.faster(said, 1e-9)) - own).max()
    assert 1e-10 < allowed < 1e-5
    for other in others:
        assert np.abs(states(other) - own).max() < allowed
