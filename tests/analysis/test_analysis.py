"""A finished run as arrays, tables and comparisons; laws that can fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis import tables
from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import MissingPackageError
from tests.changed_logs import with_records
from tests.scenes import two_balls


@pytest.fixture(scope="module")
def hit(tmp_path_factory, ffsm_run):
    """Two balls, e = 1, in contact at 0.3 s."""
    return ffsm_run(two_balls(tmp_path_factory.mktemp("hit"), duration_s=0.5))


def check(run, name, subsystem="total", **tolerance):
    return next(x for x in run.checks(**tolerance) if (x.name, x.subsystem) == (name, subsystem))


def test_arrays_by_name(hit):
    np.testing.assert_array_equal(hit.momentum("robot")[:, 0], hit["momentum.robot_P_x_N_s"])
    np.testing.assert_array_equal(hit.momentum()[:, 5], hit["momentum.total_L_z_N_m_s"])
    assert hit.qpos.shape == (501, 2)
    np.testing.assert_array_equal(hit.qvel[:, 1], hit["state.v_target_x_m_s"])
    assert hit.units["energy.total_J"] == "J"
    assert hit.descriptions["energy.total_J"] == "kinetic energy, total"
    with pytest.raises(KeyError, match="unknown subsystem 'object'"):
        hit.momentum("object")
    with pytest.raises(KeyError, match=r"unknown signal 'energy\.total'"):
        hit["energy.total"]


def test_blocks_are_the_rows_in_order(baseline):
    blocks = list(baseline.log.blocks())
    assert len(blocks) > 2
    np.testing.assert_array_equal(np.concatenate(blocks), baseline.log.rows)


def test_tables_in_pandas_and_polars(hit):
    samples = hit.to_pandas()
    np.testing.assert_array_equal(samples["energy.total_J"], hit["energy.total_J"])
    assert samples.attrs["units"]["momentum.total_P_x_N_s"] == "N s"
    impacts = hit.to_polars("impacts")
    assert impacts["impulse_N_s"].to_list() == [hit.impacts[0].impulse_N_s]
    assert impacts["point_x_m"].to_list() == [hit.impacts[0].point_m[0]]
    assert hit.to_pandas("phases")["name"].to_list() == ["coast"]
    assert hit.to_pandas("checks")["passes"].all()
    with pytest.raises(KeyError, match="unknown table 'sample'"):
        hit.table("sample")


def test_a_missing_package_is_named(hit, monkeypatch):
    def nothing(name):
        raise ImportError(name)

    monkeypatch.setattr(tables, "import_module", nothing)
    with pytest.raises(MissingPackageError, match=r"install it by: uv sync --inexact --extra tables"):
        hit.to_polars()


@pytest.mark.parametrize("restitution", [1.0, 0.5, 0.0])
def test_impact_laws_catch_a_wrong_impact(tmp_path, restitution):
    """2 kg at 1 m/s on 3 kg: the energy lost is the work of the impulse, whatever e; a log that says otherwise fails."""
    path = two_balls(tmp_path, duration_s=0.31, restitution=restitution)
    run = ffsm_mj.run(path)
    record = run.impacts[0]
    assert record.energy_change_J == pytest.approx(-0.6 * (1 - restitution**2), abs=1e-12)
    assert check(run, "impact energy").residual < 1e-15
    for change, broken in (
        ({"energy_change_J": record.energy_change_J + 1e-6}, "impact energy"),
        ({"separation_speed_m_s": record.separation_speed_m_s + 1e-6}, "impact restitution"),
    ):
        wrong = Run(with_records(run.log, {"impacts": (replace(record, **change),)}))
        assert not check(wrong, broken).passes
        assert check(wrong, broken).residual == pytest.approx(1e-6, rel=1e-6)
        assert check(wrong, broken).component == "impact 1"
        assert check(wrong, broken).time_s == record.time_s


def test_the_worst_residual_is_found_where_it_is(hit):
    """A leak planted in one component at one time is reported there, and only by the laws that it breaks."""
    rows = hit.log.rows.copy()
    rows[123, hit.keys.index("momentum.objects_P_x_N_s")] += 1e-6
    wrong = Run(replace(hit.log, rows=rows))
    broken = [x for x in wrong.checks() if not x.passes]
    assert [(x.name, x.subsystem, x.component) for x in broken] == [("linear momentum", "objects", "P_x")]
    assert broken[0].time_s == 0.123
    assert broken[0].residual == pytest.approx(1e-6, rel=1e-6)
    assert all(x.passes for x in wrong.checks({"linear momentum": 1e-5}))
    assert not all(x.passes for x in wrong.checks({"angular momentum": 1e-5}))
    with pytest.raises(KeyError, match="unknown check 'charm'"):
        wrong.checks({"charm": 1.0})


def test_a_run_is_the_same_as_itself(hit):
    found = ffsm_mj.compare(hit, hit)
    assert found.same
    assert found.samples == 501
    assert found.first_s is None


def test_comparison_pairs_rows_of_one_time(hit):
    """Where a damaged log repeats a sample, or has one without a time."""
    rows = np.array(hit.log.rows)
    repeated = np.insert(rows, 100, rows[100], axis=0)
    repeated[[0, 1], hit.log.header.layout.time] = np.inf, np.nan
    found = ffsm_mj.compare(hit, Run(replace(hit.log, rows=repeated)))
    assert (found.samples, found.same) == (499, True)
    repeated[201] += 1e-3 * np.arange(rows.shape[1])  # the sample at 0.2 s, but for its time
    found = ffsm_mj.compare(hit, Run(replace(hit.log, rows=repeated)))
    assert {each.time_s for each in found.signals} == {0.2}
    assert len(found.signals) == np.isfinite(rows[200]).sum() - 1


def test_comparison_finds_what_differs_and_when(hit, tmp_path):
    """Half the restitution: equal up to the impact, then v = 0.2 and 0.4 m/s faster or slower by the closed form."""
    other = ffsm_mj.run(two_balls(tmp_path, duration_s=0.4, restitution=0.5))
    found = ffsm_mj.compare(hit, other)
    assert found.scenario == (("duration_s", 0.5, 0.4), ("contacts.rules.0.restitution", 1.0, 0.5))
    assert found.models == ()
    assert found.samples == 401
    assert found.first_s == pytest.approx(0.3, abs=1.5e-3)  # the first tick at or after the impact
    (pair,) = found.impacts
    assert pair.time_s == pytest.approx(0.0, abs=1e-12)
    assert pair.impulse_N_s == pytest.approx(-0.6, abs=1e-12)  # (1 + e) u m1 m2 / (m1 + m2) = 1.2 (1 + e)
    differences = {d.key: d for d in found.signals}
    assert differences["state.v_target_x_m_s"].largest == pytest.approx(0.2, abs=1e-12)
    assert differences["state.q_robot_x_m"].largest == pytest.approx(0.3 * 0.1, abs=1e-9)
    assert differences["state.q_robot_x_m"].time_s == pytest.approx(0.4)
    assert not [key for key in differences if key.startswith("momentum.total")]


def test_comparison_with_another_model_and_no_impact(hit, tmp_path):
    path = two_balls(tmp_path, duration_s=0.2)
    text = (tmp_path / "robot.xml").read_text()
    (tmp_path / "robot.xml").write_text(text.replace('mass="2.0"', 'mass="2.5"'))
    found = ffsm_mj.compare(hit, ffsm_mj.run(path))
    assert found.models == ("mjcf/robot/robot.xml",)
    assert found.impacts[0].b is None
    assert np.isnan(found.impacts[0].impulse_N_s)
    assert "energy.total_J" in {d.key for d in found.signals}
