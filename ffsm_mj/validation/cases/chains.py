"""Several contacts at one instant: Newton's cradle, and spheres in a row with friction."""

from __future__ import annotations

from itertools import pairwise

from ffsm_mj.validation.case import Number, Origin, Topic, ValidationCase, Values
from ffsm_mj.validation.scene import ball, final, model, run_scene, slide, text_of, times

_RADIUS_M = 0.5


def _row(moving: int, resting: int, e: float) -> list[float]:
    """Velocities after the impact of touching balls on touching balls at rest, m/s."""
    names = [f"ball{i}" for i in range(moving + resting)]
    models = {
        name: model(ball(name, 1.0, _RADIUS_M, joint=slide("x", "1 0 0"), at=(i + (0.1 if i >= moving else 0.0), 0, 0)))
        for i, name in enumerate(names)
    }
    geoms = ["ball0", *(f"{name}/{name}" for name in names[1:])]
    run = run_scene(
        models.pop("ball0"),
        models,
        initial={"rates": {"robot/x": 1.0} | {f"{name}/x": 1.0 for name in names[1:moving]}},
        contacts={"rules": [{"between": list(pair), "restitution": e} for pair in pairwise(geoms)]},
        **times(1e-3, 0.15),
    )
    return [float(final(run, f"v_{subsystem}_x")[0]) for subsystem in ("robot", *names[1:])]


def _cradle() -> Values:
    values: dict[str, float] = {}
    for name, row in {"1_2": (1, 2, 1.0), "2_2": (2, 2, 1.0), "half": (1, 2, 0.5)}.items():
        values |= {f"{name}_{i}": speed for i, speed in enumerate(_row(*row))}
    return values


def _numbers(name: str, what: str, values: tuple[float, ...]) -> list[Number]:
    why = "rounding of velocities of 1 m/s"
    return [
        Number(f"{name}_{i}", f"{what}: ball {i + 1}, m/s", text_of(value), 1e-12, why) for i, value in enumerate(values)
    ]


CASES = (
    ValidationCase(
        "newtons-cradle",
        "Newton's cradle: equal balls in contact",
        Topic.SEVERAL_CONTACTS,
        Origin.PUBLISHED,
        "Smith, Kaufman, Vouga, Tamstorf & Grinspun 2012, Reflections on simultaneous impact, ACM TOG 31(4),"
        " article 106:"
        " generalised reflections give the textbook cradle (0, 0, 1); Newton's law for all contacts at once gives (-1/3,"
        " 2/3, 2/3)",
        "Impact law `blend`. Equal balls of 1 kg at 1 m/s, e = 1; and e = 0.5, where the law is the mean of"
        " plastic (1/3 each)"
        " and elastic.",
        (
            *_numbers("1_2", "one on two", (0.0, 0.0, 1.0)),
            *_numbers("2_2", "two on two", (0.0, 0.0, 1.0, 1.0)),
            *_numbers("half", "one on two, e = 0.5", (1 / 6, 1 / 6, 2 / 3)),
        ),
        _cradle,
        "A convention, not the only answer: equal springs in the place of the contacts give (-0.130, 0.150, 0.980).",
    ),
)
