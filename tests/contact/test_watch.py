"""Detection of unhandled contacts."""

from __future__ import annotations

import mujoco

from ffsm_mj.contact.watch import ContactWatch

BALLS = "".join(
    f'<body name="{name}" pos="{x} 0 0"><freejoint/><geom name="{name}" size="0.1" mass="1"/></body>'
    for name, x in (("a", 0.0), ("b", 0.15), ("c", 0.3))
)


def test_the_ignored_pairs_may_change_during_an_overlap():
    """Pairs on one rigid body are ignored while they are on it, and reported afterwards."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{BALLS}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    first, second = (frozenset(model.geom(name).id for name in names) for names in ("ab", "bc"))
    watch = ContactWatch(model, data, [first])
    watch.disabled = frozenset([second])
    for k in range(3):
        assert watch.look(0.1 * k) == []
    assert watch.finish(0.3) == []
    watch.disabled = frozenset()
    for k in range(3, 6):
        assert watch.look(0.1 * k) == []
    watch.disabled = frozenset([second])
    (record,) = watch.look(0.6)
    assert (record.geoms, record.start_s, record.end_s) == (("b", "c"), 3 * 0.1, 0.6)
    assert abs(record.max_depth_m - 0.05) < 1e-12
