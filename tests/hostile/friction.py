"""A series of its own of friction at impacts: mutated pairs with ``mu``, and mutated logs of runs whose bodies rubbed."""

from __future__ import annotations

from random import Random

from tests.hostile.cases import Case, commands, log_case_of, model_text
from tests.hostile.documents import Map, Raw, shipped, text, tree_of
from tests.hostile.values import YAML_NUMBERS, words
from tests.hostile.yaml_mutations import mutate_tree, mutate_within, scale_numbers

FRICTION = 20
"""The seed of the series."""

_LANES = ("robot", "servicer_2", "servicer_3")
_ROBOT, _OBJECT = "servicer_free.xml", "satellite_drum.xml"
_WORDS = (
    *words("mu mu-0 rough/drum rougher drum robot/probe robot/base servicer_2/base blend newton self"),
    *("*", "robot/*", "robot/base/*", "/*", ""),
)
_KEYS = ("mu", "friction", "restitution", "super_elastic", "between", "default", "rules", "ignored", "name", "law")
_MU = ("0", "-0.0", "5e-324", "1e-300", "1e-9", "1.5", "10", "1e6", "1e100", "1e308", "+.5", "0x1")
_NO_MU = (*YAML_NUMBERS, "[0.3]", "{static: 0.3}", "~", "on", "0.3 N", "-0.1")
_LAWS = (*("blend",) * 5, *("poisson",) * 4, "newton")


def scenario(gaps: tuple[float, float, float] = (0.003, 0.006, 0.009), law: str = "blend") -> Map:
    """The scenario ``spin-transfer``, its probes so many metres before their drums, at 0.3 m/s."""
    tree = shipped("spin-transfer")
    sections = dict(tree.pairs)
    places = dict(dict(sections["initial"].pairs)["joints"].pairs)
    for lane, gap in zip(_LANES, gaps, strict=True):
        # Probe and drum are spheres of 0.06 and 0.5 m across the lane, 0.2 m off the drum's axis; the probe is 1 m ahead.
        places[f"{lane}/free"][0] = -1.0 - (0.56**2 - 0.2**2) ** 0.5 - gap
    sections["objects"] = tree_of(
        {name: {"mjcf": "robot.xml" if name in _LANES else "object.xml"} for name, _ in sections["objects"].pairs}
    )
    sections["robot"] = tree_of({"mjcf": "robot.xml"})
    sections["impact"] = tree_of({"law": law})
    return Map([*({"duration_s": 0.06} | {name: item for name, item in sections.items() if name != "duration_s"}).items()])


def models() -> dict[str, bytes]:
    """Files beside it."""
    return {"robot.xml": model_text(_ROBOT), "object.xml": model_text(_OBJECT)}


def drawn(number: int, data: bytes) -> Case:
    """A case of the series; a log of impacts with friction is there to be mutated."""
    rng = Random(f"{FRICTION}:{number}")
    if rng.random() < 0.7:
        return _scenario_case(rng)
    return log_case_of(
        rng,
        data,
        "friction",
        (0.67, (1, 1, 2, 4)),
        ("/ffsm/impact", "/ffsm/impact", "/ffsm/impact", "/ffsm/sample"),
        ("samples", "impacts", "checks"),
    )


def _scenario_case(rng: Random) -> Case:
    """Impacts one after the other, or all at one instant."""
    tree = scenario(rng.choice(((0.003, 0.006, 0.009), (0.006, 0.006, 0.006))), rng.choice(_LAWS))
    pairs = dict(dict(tree.pairs)["contacts"].pairs)["rules"]
    words = _NO_MU if rng.random() < 0.2 else _MU
    for pair in rng.sample(pairs, rng.choice((0, 1, 1, 3))):
        pair.pairs = [*((name, item) for name, item in pair.pairs if name != "mu"), ("mu", Raw(rng.choice(words)))]
    for _ in range(rng.choice((0, 0, 0, 1, 2))):
        mutate_within(rng, tree, ("contacts", "impact"), _WORDS, _KEYS)
    if rng.random() < 0.4:
        scale_numbers(rng, tree)
    if rng.random() < 0.1:
        mutate_tree(rng, tree)
    return Case(
        "friction",
        {"scenario.yaml": text(tree).encode("utf-8", "surrogatepass"), **models()},
        commands(rng, "scenario.yaml"),
    )
