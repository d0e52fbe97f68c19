"""A run says what its log says, by arithmetic; what needs its models is asked of functions."""

from __future__ import annotations

import pickle
from dataclasses import replace

import mujoco
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.analysis.tables import table_names
from ffsm_mj.verification.independent.finding import TOLERANCES
from tests.changed_logs import with_records
from tests.scenes import ball, box, scene


@pytest.fixture(scope="module")
def rough(tmp_path_factory):
    """A ball meets a box off its centre, with friction."""
    path = scene(
        tmp_path_factory.mktemp("rough"),
        ball("ball", mass=2.0),
        {"box": box("box", mass=3.0, half=(0.2, 0.3, 0.25))},
        initial={
            "joints": {"robot/free": [0.0, 0.05, 0.02, 1, 0, 0, 0], "box/free": [0.6, 0, 0, 1, 0, 0, 0]},
            "rates": {"robot/free": [1.0, 0.2, 0, 0, 0, 0]},
        },
        contacts={"rules": [{"between": ["ball", "box/box"], "restitution": 0.5, "mu": 0.3}]},
        duration_s=0.5,
    )
    return ffsm_mj.run(path, out=path.parent / "out", rerun=False)


def test_a_run_compiles_nothing(rough, monkeypatch):
    """Checks, summary, tables and representations of a log, with impacts whose check has a part that needs the models."""

    def never(*_, **__):
        raise AssertionError("a model is compiled")

    assert rough.impacts[0].mu > 0.0
    run = ffsm_mj.load_run(rough.path)
    with monkeypatch.context() as patched:
        for owner, name in ((mujoco.MjSpec, "compile"), (mujoco.MjModel, "from_xml_string"), (mujoco, "MjData")):
            patched.setattr(owner, name, never)
        checks = run.checks()
        assert {check.name for check in checks} >= {"energy", "linear momentum", "impact energy"}
        assert all(check.passes for check in checks)
        assert "checks" not in run.summary()
        assert f"all {len(checks)} checks of rows and records pass" in repr(run)
        assert f"all {len(checks)} checks of rows and records pass" in run._repr_html_()
        assert len(run.table("checks").columns["name"]) == len(checks)
        assert all(run.table(name).name == name for name in table_names(run.log))
        with pytest.raises(AssertionError, match="a model is compiled"):
            all_checks(run)


def test_all_checks_are_those_of_the_rows_and_those_with_the_models(rough):
    """Of a run that was made here and of its log; what the models add to the energy of an impact is in its check."""
    run = ffsm_mj.load_run(rough.path)
    found = all_checks(run)
    assert found == all_checks(rough) == ffsm_mj.explain(run).checks
    of_rows = {(check.name, check.subsystem) for check in run.checks()}
    more = {check.name for check in found if (check.name, check.subsystem) not in of_rows}
    assert more
    assert more <= set(TOLERANCES)
    with pytest.raises(KeyError, match="unknown check 'charm'"):
        all_checks(run, {"charm": 1.0})


def test_records_that_contradict_each_other_fail_without_the_models(rough):
    """An energy change that the impulses did not do."""
    (hit,) = rough.impacts
    wrong = replace(hit, energy_change_J=hit.energy_change_J + 1e-6)
    run = ffsm_mj.Run(with_records(rough.log, {"impacts": (wrong,)}))
    assert [check.name for check in run.checks() if not check.passes] == ["impact energy"]


def test_a_run_is_pickled_with_what_was_computed(rough):
    """In memory and read from a log, before and after its checks."""
    path = rough.path.parent / "scenario.yaml"
    for run in (ffsm_mj.run(path), ffsm_mj.load_run(rough.path)):
        assert all_checks(pickle.loads(pickle.dumps(run))) == all_checks(run)
        assert all_checks(pickle.loads(pickle.dumps(run))) == all_checks(run)


def test_summary_is_that_of_the_file(rough):
    summary = ffsm_mj.summary(rough)
    assert {*summary} - {*rough.summary()} == {"effort", "base_rotation", "angular_momentum", "checks"}
    assert summary["effort"] == ffsm_mj.effort(rough)
    assert summary["angular_momentum"] == ffsm_mj.angular_momentum(rough)
    changed = ffsm_mj.effort(rough)
    changed.clear()
    assert ffsm_mj.summary(rough) == summary
