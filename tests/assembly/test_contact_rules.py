"""Contact rules against a plain reading of what they mean, pair by pair, for random lists of rules."""

from __future__ import annotations

from itertools import combinations

import mujoco
import numpy as np
import pytest

from ffsm_mj.assembly.contact_rules import resolve_contacts
from ffsm_mj.contact.watch import collidable
from ffsm_mj.errors import ScenarioFaults
from ffsm_mj.scenario.contacts import ContactsConfig
from tests.scenes import HEAD, ball, compile_paths

ARM = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint/><geom name="base" size="0.1"/><geom name="plume" contype="0"
  conaffinity="0" size="1"/><geom size="0.1" pos="0 0 1"/>
  <body name="upper" pos="0 0 2"><joint axis="0 0 1"/><geom name="upper" size="0.1"/>
    <body name="hand" pos="0 0 2"><joint axis="0 1 0"/><geom name="palm" size="0.1"/>
      <body name="finger" pos="0 0 2"><joint axis="0 1 0"/><geom name="finger" size="0.1"/></body>
      <body name="thumb" pos="0 1 2"><joint axis="0 1 0"/><geom name="thumb" size="0.1"/></body></body></body></body>
  </worldbody><contact><exclude body1="base" body2="thumb"/></contact></mujoco>"""
NAMES = (
    *("robot", "rock", "stone", "*", "self", "hand/*", "robot/upper/*", "hand", "upper", "base", "palm", "robot/finger"),
    *("thumb", "plume", "base_geom", "rock/rock", "stone/stone"),
)


@pytest.fixture(scope="module")
def system(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rules")
    (folder / "arm.xml").write_text(ARM)
    for name in ("rock", "stone"):
        (folder / f"{name}.xml").write_text(ball(name))
    return compile_paths(folder / "arm.xml", {name: folder / f"{name}.xml" for name in ("rock", "stone")})


class Reading:
    """What a rule says, in loops and texts."""

    def __init__(self, system):
        self.model, self.can = system.mj, collidable(system.mj)
        self.names = [self.model.geom(g).name for g in range(self.model.ngeom)]

    def bodies_above(self, geom):
        body = int(self.model.geom_bodyid[geom])
        while body:
            yield self.model.body(body).name
            body = int(self.model.body_parentid[body])

    def is_geom(self, side):
        is_model = side in ("robot", "rock", "stone")  # a model before a geom
        return side in self.names or (not is_model and [name.split("/")[1] for name in self.names].count(side) == 1)

    def part(self, geom):
        return self.names[geom].split("/")[0]

    def has(self, side, geom):
        name = self.names[geom]
        if side in ("robot", "rock", "stone"):
            return self.part(geom) == side
        if side == "*":
            return True
        if side.endswith("/*"):
            return any(above in (side[:-2], f"robot/{side[:-2]}") for above in self.bodies_above(geom))
        if self.is_geom(side):
            return name == side or name.split("/")[1] == side
        return next(self.bodies_above(geom)) in (side, f"robot/{side}")

    def names_pair(self, between, a, b, *, filtered=True):
        if "self" in between:
            (side,) = (side for side in between if side != "self")
            hit = self.part(a) == self.part(b) and (self.has(side, a) or self.has(side, b))
        else:
            one, other = between
            hit = (self.has(one, a) and self.has(other, b)) or (self.has(one, b) and self.has(other, a))
        if "*" in between and self.part(a) == self.part(b):
            return False
        explicit = all(self.is_geom(side) for side in between)
        return hit and (explicit or not filtered or bool(self.can[a, b]))

    def winners(self, rules, ignored):
        """Rule of each pair by the plain reading: the last that names it, unless it is ignored."""
        found = {}
        for a, b in combinations(range(self.model.ngeom), 2):
            if any(self.names_pair(each, a, b, filtered=False) for each in ignored):
                continue
            named = [i for i, between in enumerate(rules) if self.names_pair(between, a, b)]
            if named:
                found[frozenset((a, b))] = named[-1]
        return found


def draw(rng):
    while True:
        between = tuple(rng.choice(NAMES, 2).tolist())
        if between.count("self") < 2 and not ("self" in between and "*" in between):
            return between


def resolved(config, system):
    """The contacts of a configuration, or the messages of its faults."""
    try:
        return resolve_contacts(config, system), []
    except ScenarioFaults as refused:
        return None, [fault.message for fault in refused.faults]


def test_the_last_rule_that_names_a_pair_has_it_for_random_rules(system):
    """Rules that are refused are those that have no pair by the plain reading, or that name a pair that cannot meet."""
    rng, reading, accepted = np.random.default_rng(7), Reading(system), 0
    for _ in range(400):
        rules = [draw(rng) for _ in range(rng.integers(1, 6))]
        ignored = [draw(rng) for _ in range(rng.integers(0, 2))]
        config = ContactsConfig.model_validate(
            {
                "rules": [
                    {"between": between, "name": f"rule {i}", "restitution": i / 10} for i, between in enumerate(rules)
                ],
                "ignored": [{"between": between, "reason": "a test"} for between in ignored],
            }
        )
        expected = reading.winners(rules, ignored)
        without = set(range(len(rules))) - set(expected.values())
        contacts, faults = resolved(config, system)
        if contacts is None:
            assert without or any("on one rigid body" in fault for fault in faults), (rules, ignored, faults)
            continue
        assert not without, (rules, ignored)
        winners = {ids: int(pair.rule.split()[1]) for pair in contacts.pairs for ids in pair.geom_pairs}
        assert winners == expected, (rules, ignored)
        assert all(pair.restitution == int(pair.rule.split()[1]) / 10 for pair in contacts.pairs)
        accepted += 1
    assert accepted > 60


def test_the_default_is_every_two_models(system):
    contacts = resolve_contacts(ContactsConfig(), system)
    reading = Reading(system)
    expected = {
        frozenset((a, b))
        for a, b in combinations(range(system.mj.ngeom), 2)
        if reading.part(a) != reading.part(b) and reading.can[a, b]
    }
    assert {pair.geom_ids for pair in contacts.pairs} == expected
    assert [rule.name for rule in contacts.rules] == ["robot-rock", "robot-stone", "rock-stone"]
    assert all(pair.robot_on_object for pair in contacts.pairs if pair.rule != "rock-stone")
    # What is left out is the robot with itself: bodies two joints apart or more, but for the excluded ones.
    assert {frozenset(map(reading.names.__getitem__, pair)) for pair in contacts.left_out} == {
        frozenset((f"robot/{a}", f"robot/{b}"))
        for a, b in [
            *(("base", "palm"), ("base", "finger"), ("base_geom", "palm"), ("base_geom", "finger")),
            *(("upper", "finger"), ("upper", "thumb"), ("finger", "thumb")),
        ]
    }


def test_a_fixed_object_meets_what_moves():
    """Geoms of a fixed object are welded to the world: MuJoCo's filter of parents does not spare the base from them."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="wall"><geom size="1"/></body>
        <body name="base"><freejoint/><geom size="1"/></body></worldbody></mujoco>"""
    )
    assert collidable(model).tolist() == [[False, True], [True, False]]
