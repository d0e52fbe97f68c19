"""The watch over contacts that nobody resolves."""

from __future__ import annotations

import mujoco

from ffsm_mj.contact.watch import ContactWatch

BALLS = "".join(
    f'<body name="{name}" pos="{x} 0 0"><freejoint/><geom name="{name}" size="0.1" mass="1"/></body>'
    for name, x in (("a", 0.0), ("b", 0.15), ("c", 0.3))
)


def test_who_is_known_may_change_while_the_same_pairs_overlap():
    """Pairs that are one rigid body are left out as long as they are, and told of from then on."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{BALLS}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    first, second = (frozenset(model.geom(name).id for name in names) for names in ("ab", "bc"))
    watch = ContactWatch(model, data, [first])
    watch.rigid = frozenset([second])
    for k in range(3):
        assert watch.look(0.1 * k) == []
    assert watch.finish(0.3) == []
    watch.rigid = frozenset()
    for k in range(3, 6):
        assert watch.look(0.1 * k) == []
    watch.rigid = frozenset([second])
    (told,) = watch.look(0.6)
    assert (told.geoms, told.start_s, told.end_s) == (("b", "c"), 3 * 0.1, 0.6)
    assert abs(told.max_depth_m - 0.05) < 1e-12
