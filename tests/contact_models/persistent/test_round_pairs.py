"""Cylinders and ellipsoids on each other: they slide, press and come to rest like other shapes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.contact_models.interface import first_root
from ffsm_mj.contact_models.persistent.model import first_change
from tests.contact_models.persistent.random_pushes import drawn
from tests.contact_models.persistent.test_random_pushes import wrong
from tests.replays import proved
from tests.scenes import scene

G = 9.81
HEAD = f'<option gravity="0 0 -{G}"/>'
LEVEL = 'euler="90 0 0"'
CYLINDERS = f'type="cylinder" size="0.1 0.2" {LEVEL}', f'type="cylinder" size="0.2 0.3" {LEVEL}'
SPHEROIDS = 'type="ellipsoid" size="0.1 0.25 0.1"', 'type="ellipsoid" size="0.2 0.15 0.2"'


def on_top(folder, moving, names, **scenario):
    """A body that slides in x and z over a fixed one with the geoms of some names."""
    robot = f"""<mujoco>{HEAD}<worldbody><body name="b"><joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
      <geom name="g" {moving} mass="0"/></body></worldbody></mujoco>"""
    geoms = "".join(f'<geom name="{name}" {geom}/>' for name, geom in names.items())
    base = f"<mujoco>{HEAD}<worldbody>{geoms}</worldbody></mujoco>"
    return scene(
        folder,
        robot,
        {"base": base},
        fixed={"base": {}},
        conservative=False,
        contacts={"rules": [{"between": ["robot/g", f"base/{name}"], "restitution": 0.3} for name in names]},
        **{"duration_s": 0.45, "time_step_s": 2e-3, "control_period_s": 2e-3} | scenario,
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("moving", "fixed", "mode", "points"),
    [
        (*CYLINDERS, "side on rim", 2),
        (*SPHEROIDS, "ellipsoid on ellipsoid", 1),
        (SPHEROIDS[0], CYLINDERS[1], "side on ellipsoid", 1),
    ],
)
def test_what_slides_off_a_smooth_circle_leaves_it_where_its_weight_no_longer_bends_its_path(
    tmp_path, moving, fixed, mode, points
):
    """A point on a circle of r = 0.3 m leaves at v^2 = g r cos: cos = 2/3 + v0^2 / (3 g r), with v0 at the top.

    The force falls to zero at the rate 3 g m sin' = 40 N/s, and RK4 at 2 ms errs by (v h / r)^4 / 120 = 1e-9 of it.
    """
    speed, r = 0.3, 0.3
    run = proved(
        ffsm_mj.run(
            on_top(tmp_path, moving, {"base": fixed}, initial={"joints": {"robot/z": r}, "rates": {"robot/x": speed}})
        )
    )
    (begins,), (ends,) = run.records["contact_beginnings"], run.records["contact_endings"]
    assert (begins.mode, begins.points) == (mode, points)
    assert -ends.normal[2] == pytest.approx(2.0 / 3.0 + speed**2 / (3.0 * G * r), abs=1e-8)
    assert not run.records["contact_changes"]


@pytest.mark.long
@pytest.mark.parametrize("step", [5e-4, 1e-2])
@pytest.mark.parametrize("moving", [SPHEROIDS[0], CYLINDERS[0]])
def test_what_falls_into_a_groove_bounces_and_rests_on_both_sides(tmp_path, moving, step):
    """Between two cylinders at x = +-0.15 m, radius 0.1 m as its own, each bears m g / (2 cos), with sin = 0.15 / 0.2."""
    sides = {name: f'type="cylinder" size="0.1 0.4" {LEVEL} pos="{x} 0 0"' for name, x in (("left", -0.15), ("right", 0.15))}
    initial, steps = {"joints": {"robot/z": 0.14}}, {"time_step_s": step, "control_period_s": step}
    run = proved(ffsm_mj.run(on_top(tmp_path, moving, sides, initial=initial, duration_s=0.2, **steps)))
    assert len(run.impacts) >= 4
    for name in sides:
        force = run[f"contact.robot_g_base_{name}_force_N"][-1]
        assert force == pytest.approx(2.0 * G / (2.0 * np.sqrt(1.0 - 0.75**2)), rel=1e-9)


def test_a_tilted_cylinder_slides_over_the_rim_of_a_cap(tmp_path):
    """Its rim is on the cap, then on the rim of the cap."""
    robot = f"""<mujoco>{HEAD}<worldbody><body name="b"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.011 0.012"/>
      <geom name="g" type="cylinder" size="0.13 0.14" mass="0"/>
      </body></worldbody></mujoco>"""
    base = f'<mujoco>{HEAD}<worldbody><geom name="base" type="cylinder" size="0.132 0.1"/></worldbody></mujoco>'
    path = scene(
        tmp_path,
        robot,
        {"base": base},
        fixed={"base": {}},
        conservative=False,
        duration_s=0.094,
        initial={"joints": {"robot/free": [-0.017, -0.005, 0.2672, np.cos(0.1), np.sin(0.1), 0, 0]}},
        contacts={"rules": [{"between": ["robot/g", "base/base"], "restitution": 0.0}]},
    )
    run = proved(ffsm_mj.run(path))
    modes = [each.mode for each in (*run.records["contact_beginnings"], *run.records["contact_changes"])]
    assert modes[0] == "rim on cap"
    assert "rim on rim" in modes


# A side across the tangent of a rim, whose cross product vanishes there.
@pytest.mark.parametrize("seed", [26, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(101, 121))])
def test_random_pushes_of_round_bodies(tmp_path, seed):
    assert wrong(drawn(np.random.default_rng(seed), tmp_path, kinds=("cylinder", "ellipsoid"))) == []


def test_the_first_of_three_roots_is_found():
    """The middle of the way to the last one is between the others, where the function is positive again."""
    root = first_root(lambda time_s: -(time_s - 0.2) * (time_s - 0.3) * (time_s - 0.9), 1.0)
    assert root == pytest.approx(0.2, abs=1e-12)


def test_the_first_of_several_changes_in_a_step_is_found():
    """A gap that drifts out of its bound, and crosses it again on its way to the other side."""
    now = SimpleNamespace(time_s=0.0)
    path = SimpleNamespace(move_to=lambda time_s: setattr(now, "time_s", time_s))

    def value(*, exact=False):  # noqa: ARG001
        drift = 40.0 * now.time_s**2 * (0.8 - now.time_s)
        return 0.1 - abs(drift)

    closed_contacts = SimpleNamespace(
        motion=SimpleNamespace(path=path),
        witness_value=value,
        touches_elsewhere=lambda: False,
        pairs_with_drift=list,
        note_release=int,
    )
    changed, _ = first_change(closed_contacts, (1.0,))
    assert 40.0 * changed**2 * (0.8 - changed) == pytest.approx(0.1, abs=1e-9)
    assert changed < 0.1
