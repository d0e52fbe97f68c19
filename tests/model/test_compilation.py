"""Compilation without output of libraries: standard error is the same afterwards, whatever the number of threads."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import mujoco
import pytest

from ffsm_mj.model.source import compile_spec

BALL = '<mujoco><worldbody><geom size="1"/></worldbody></mujoco>'
FLAT = """<mujoco><asset><mesh name="flat" vertex="0 0 0  1e8 0 0  0 .3 .4  0 .3 .4000001"/></asset>
  <worldbody><geom type="mesh" mesh="flat"/></worldbody></mujoco>"""


def test_threads_leave_standard_error_as_it_was(capfd):
    """Without a lock, one thread restores the null device that another has put there."""
    before = os.fstat(2)

    def compiled(_):
        return compile_spec(mujoco.MjSpec.from_string(BALL), mujoco.MjVfs()).ngeom

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(compiled, range(400))) == [1] * 400
    after = os.fstat(2)
    assert (after.st_dev, after.st_ino) == (before.st_dev, before.st_ino)
    os.write(2, b"heard")
    assert capfd.readouterr().err == "heard"


def test_a_flat_mesh_is_an_exception_only(capfd):
    """Qhull prints a page about it."""
    with pytest.raises(ValueError, match=r"qhull|volume|mesh"):
        compile_spec(mujoco.MjSpec.from_string(FLAT), mujoco.MjVfs())
    assert capfd.readouterr().err == ""
