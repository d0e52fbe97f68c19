"""Compilation: again in one process, in threads, without output of libraries; warnings reach their own thread alone."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from threading import Thread

import mujoco
import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from ffsm_mj.model.mujoco_process import collected_warnings
from ffsm_mj.model.source import compile_spec
from tests.scenes import two_balls

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


def test_a_model_compiled_again_has_the_same_notes_and_properties(tmp_path):
    scenario = two_balls(tmp_path, model={"robot": {"ball": {"mass_kg": 5}}})
    first, second = (prepare(scenario) for _ in range(2))
    assert first.system.notes == second.system.notes
    assert first.changes == second.changes
    assert first.system.mj.body_mass.tolist() == second.system.mj.body_mass.tolist()


def test_other_overrides_of_the_same_files_do_not_see_the_first_ones(tmp_path):
    plain = two_balls(tmp_path)
    robot = tmp_path / "robot.xml"
    robot.write_text(robot.read_text().replace('mass="0"', 'mass="1"'))  # for mass_from_geoms
    before = prepare(plain).system.mj.body_inertia.tolist()
    prepare(plain, {"model.robot.ball.mass_kg": 7.0})
    prepare(plain, {"model.robot.ball.geoms.ball.size_m": [0.3], "model.robot.ball.mass_from_geoms": True})
    assert prepare(plain).system.mj.body_inertia.tolist() == before


def test_it_is_refused_each_time(tmp_path):
    scenario = two_balls(tmp_path)
    robot = tmp_path / "robot.xml"
    robot.write_text(robot.read_text().replace("</mujoco>", '<actuator><motor joint="none"/></actuator></mujoco>'))
    for _ in range(2):
        with pytest.raises(InputError, match="none"):
            prepare(scenario)


XML = "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"


def warn(dof=0):
    """Make MuJoCo issue a warning that names a dof."""
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    data.qvel[dof] = 1e20
    mujoco.mj_step(model, data)


@pytest.fixture
def own():
    """Messages of a handler of the user, which must be restored afterwards."""
    told = []
    handler = told.append
    mujoco.set_mju_user_warning(handler)
    yield told
    found = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(None)
    assert found == handler


def elsewhere(function, *arguments):
    thread = Thread(target=function, args=arguments)
    thread.start()
    thread.join()


def test_the_innermost_collector_gets_the_warnings(own):
    outer, inner = [], []
    with collected_warnings(outer):
        warn(1)
        with collected_warnings(inner):
            warn(2)
        warn(3)
    warn(4)
    assert [text.split("DOF ")[1][0] for text in (*outer, *inner, *own)] == ["1", "3", "2", "4"]


def test_warnings_of_other_threads_reach_the_handler_of_the_user(own):
    mine = []
    with collected_warnings(mine):
        elsewhere(warn, 5)
    assert mine == []
    assert "DOF 5" in own[0]


def test_without_a_handler_mujoco_prints_and_logs_its_warnings(tmp_path, monkeypatch, capfd):
    """To the console and its log file."""
    monkeypatch.chdir(tmp_path)
    with collected_warnings([]):
        elsewhere(warn, 5)
    assert "WARNING: Nan, Inf or huge value in QVEL at DOF 5" in capfd.readouterr().err
    assert "at DOF 5" in (tmp_path / "MUJOCO_LOG.TXT").read_text()
    assert mujoco.get_mju_user_warning() is None


def test_threads_collect_separately_and_the_last_one_restores_the_handler(own):
    def collect(dof):
        mine = []
        for _ in range(20):
            with collected_warnings(mine):
                warn(dof)
        return mine

    with ThreadPoolExecutor(4) as threads:
        for dof, mine in enumerate(threads.map(collect, range(4))):
            assert len(mine) == 20
            assert all(f"DOF {dof}." in text for text in mine)
    assert own == []


@pytest.mark.usefixtures("own")
def test_a_handler_set_in_the_meantime_is_kept():
    """A later collector replaces and restores this handler, not the one before."""
    told, mine = [], []
    before, other = mujoco.get_mju_user_warning(), told.append
    with collected_warnings([]):
        mujoco.set_mju_user_warning(other)
        warn(1)
        with collected_warnings(mine):
            warn(2)
    warn(3)
    mujoco.set_mju_user_warning(before)
    assert ["DOF 2" in text for text in mine] == [True]
    assert [text.split("DOF ")[1][0] for text in told] == ["1", "3"]
