"""Columns: a new signal is declared in one place; equal names are refused."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ffsm_mj
from ffsm_controllers.phases import Phase
from ffsm_mj._core.tick import Sampler
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.control_laws import refuse_telemetry
from ffsm_mj.cli.main import main
from ffsm_mj.errors import ScenarioFaults
from ffsm_mj.log.mcap.format import SampleCodec, layout_of_schema, sample_schema
from ffsm_mj.log.rerun.plots import plots
from ffsm_mj.records.columns import Columns, Row
from ffsm_mj.records.signals import GROUPS, TIME, Layout, Signal
from ffsm_mj.simulation.rows import RowWriter
from tests.log.test_recording import read
from tests.scenes import compile_paths, two_balls

ROBOT = """<mujoco><option gravity="0 0 0"/><worldbody><body name="bus"><freejoint name="free"/><geom size=".1" mass="1"/>
  <body name="a"><joint name="{}" type="hinge" axis="0 0 1"/><geom size=".1" pos="1 0 0" mass="1"/></body>
  <body name="b"><joint name="{}" type="hinge" axis="0 0 1"/><geom size=".1" pos="2 0 0" mass="1"/></body>
  </body></worldbody><actuator><motor name="{}" joint="{}"/><motor name="{}" joint="{}"/></actuator></mujoco>"""
"""Two hinges with their motors, to be named."""


class Extra:
    """A part that reports what nobody has thought of: at sample n its signal k is 100 number + k + n / 8, exactly.

    Live, it brings its array up to date at each sample; otherwise it brings up to date what its table needs: n, and a number
    that is none of the row.
    """

    def __init__(self, number: int, groups: list[str], *, live: bool) -> None:
        self.signals = tuple(Signal(group, f"extra_{number}_{k}_m", "m", "added") for k, group in enumerate(groups))
        self._first, self._samples = 100.0 * number + np.arange(len(groups)), itertools.count()
        self._now = np.full(len(groups) if live else 2, np.nan)
        self.columns = Columns(self.signals, self._now, None if live else self._table, on_sample=self._note)

    def at(self, sample: int) -> np.ndarray:
        return self._first + sample / 8.0

    def _note(self, _: float) -> None:
        sample = next(self._samples)
        self._now[:] = self.at(sample) if self.columns.table is None else (sample, -1.0)

    def _table(self, samples: np.ndarray) -> np.ndarray:
        return np.array([*map(self.at, samples[:, 0])])


PARTS = st.lists(
    st.tuples(st.lists(st.sampled_from([*GROUPS]), min_size=1, max_size=4), st.booleans(), st.floats(0.0, 1.0)), max_size=5
)
"""Groups of the signals of each part, whether it is live, and where among the others it is added."""


def added(columns, parts):
    """Columns with those of additional components, and these components."""
    columns, extras = list(columns), []
    for number, (groups, live, place) in enumerate(parts):
        extras.append(Extra(number, groups, live=live))
        columns.insert(round(place * len(columns)), extras[-1].columns)
    return columns, extras


@pytest.fixture(scope="module")
def point(tmp_path_factory):
    """A model for the sampler to bind to, and its data."""
    (path := tmp_path_factory.mktemp("point") / "robot.xml").write_text(ROBOT.format("j", "k", "j", "j", "k", "k"))
    model = compile_paths(path).mj
    return model, mujoco.MjData(model)


@given(parts=PARTS)
@settings(max_examples=150, deadline=None)
def test_a_row_contains_the_columns_of_each_component(point, parts):
    """In blocks of two rows, as the sampler fills them, completed at once or all at the end, and as stored in a log."""
    columns, extras = added([Extra(9, ["state", "phase"], live=True).columns], parts)
    row = Row(columns)
    writer = RowWriter(row, Sampler(*point), 2)
    copies = []
    ranks = [list(GROUPS).index(signal.group) for signal in row.layout.signals]
    assert ranks == sorted(ranks)  # as a log keeps them: a message for each group
    for first in range(0, 6, 2):
        for line in range(2):
            writer.fill(line, 0.1 * (first + line))
        copies.append(writer.block.copy())
        block = writer.complete(writer.block)
        assert block.shape == (2, len(row.layout.signals))
        decoded = SampleCodec(row.layout).decode(SampleCodec(row.layout).encode(block))
        for rows in (block, decoded):
            for extra in extras:
                places = row.layout.places(signal.key for signal in extra.signals)
                np.testing.assert_array_equal(rows[:, places], [extra.at(first), extra.at(first + 1)])
    later = writer.complete(np.concatenate(copies))
    for extra in extras:
        places = row.layout.places(signal.key for signal in extra.signals)
        np.testing.assert_array_equal(later[:, places], [*map(extra.at, range(6))])


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """A run of 41 samples with an impact after 20 ms, hence two blocks of rows; its log and its recording."""
    folder = tmp_path_factory.mktemp("plain")
    path = two_balls(folder, gap=0.02, duration_s=0.04)
    return path, ffsm_mj.run(path, out=folder / "out", rerun=True), read(folder / "out" / "run.rrd")


@pytest.mark.long
@given(parts=PARTS)
@settings(max_examples=8, deadline=None)
def test_added_signals_are_read_back_and_change_no_other_column(plain, parts):
    """From memory, from MCAP, and for plotted ones from Rerun: all other columns are equal bit by bit."""
    path, usual, drawn = plain
    extras = []

    def with_parts(columns):
        found, extras[:] = added(columns, parts)
        return Row(found)

    with tempfile.TemporaryDirectory() as folder, patch("ffsm_mj.assembly.assemble.Row", with_parts):
        memory, memory_extras = ffsm_mj.run(path), extras[:]
        file = ffsm_mj.run(path, out=Path(folder) / "out", rerun=True)
        log = ffsm_mj.load_run(Path(folder) / "out")
        recording = read(Path(folder) / "out" / "run.rrd")
        told = [(memory, memory_extras), (file, extras), (log, extras)]
        for run, its in told:
            assert set(run.keys) == {*usual.keys, *(signal.key for extra in its for signal in extra.signals)}
            for key in usual.keys:
                np.testing.assert_array_equal(run[key], usual[key], err_msg=key)
            for extra in its:
                values = np.column_stack([run[signal.key] for signal in extra.signals])
                np.testing.assert_array_equal(values, [extra.at(n) for n in range(len(values))])
        assert [check.passes for check in all_checks(log)] == [check.passes for check in all_checks(usual)]
        plotted = [entity for entity, _ in recording if entity.startswith("/plots/")]
        assert len(plotted) >= 5
        for entity, component in recording:
            if entity.startswith("/plots/"):
                assert recording[entity, component] == drawn[entity, component]


def test_plots_of_rerun_show_the_columns_of_their_names(plain):
    """Each curve against its column of the log, at the times of the frames."""
    _, run, drawn = plain
    system = compile_paths(run.path.parent / "mjcf/robot/robot.xml", {"target": run.path.parent / "mjcf/target/target.xml"})
    layout = run.log.header.layout
    found = plots(layout, system, run.log.header.metadata)
    assert {plot.entity for plot in found} >= {"plots/energy", "plots/balance", "plots/linear_momentum/robot"}
    for plot in found:
        ((times, values),) = (
            tuple(zip(*rows, strict=True)) for (entity, _), rows in drawn.items() if entity == f"/{plot.entity}"
        )
        lines = np.searchsorted(run.time, np.array(times) - 1e-9)
        logged = run.log.rows[:][lines][:, plot.columns]
        if plot.logarithmic:  # residuals, as decimal logarithms of their size; 0 is far below rounding
            logged = np.log10(np.maximum(np.abs(logged), 1e-18))
        np.testing.assert_array_equal(np.array(values), logged)
    energy = next(plot for plot in found if plot.entity == "plots/energy")
    assert [layout.keys[i] for i in energy.columns] == ["energy.total_J", "energy.robot_J", "energy.objects_J"]


def test_columns_of_other_values_are_refused():
    one = (Signal("state", "a_m", "m", "one"),)
    with pytest.raises(ValueError, match=r"shape \(2,\) for 1 signals"):
        Columns(one, live=np.zeros(2))
    with pytest.raises(ValueError, match=r"two signals state.a_m: one; one"):
        Row([Columns(one, live=np.zeros(1)), Columns(one, live=np.zeros(1))])


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (("j-1", "j_1", "m", "j-1", "n", "j_1"), "robot.xml:3: 'joint robot/j-1' and 'joint robot/j_1'"),
        (("j", "k", "m.1", "j", "m-1", "k"), "robot.xml:4: 'actuator robot/m.1' and 'actuator robot/m-1'"),
    ],
)
def test_elements_with_the_same_column_name_are_refused(tmp_path, capsys, names, told):
    """In one line with both names and the file, and exit code 2."""
    path = two_balls(tmp_path)
    (tmp_path / "robot.xml").write_text(ROBOT.format(*names))
    overrides = ["contacts.rules=[]", "initial={}"]
    assert main(["check", str(path), *itertools.chain(*(("-s", one) for one in overrides))]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert str(tmp_path / told) in line
    assert "; rename one of them" in line


def test_control_laws_share_a_column_only_with_the_same_meaning():
    """A signal of several phases is one column; a different meaning is refused."""
    shared, other = (Signal("controller", "rate_rad_s", "rad/s", meaning) for meaning in ("of the arm", "of the base"))
    laws = [SimpleNamespace(telemetry_signals=(signal,)) for signal in (shared, shared, other)]
    refuse_telemetry([Phase("go", "mine", laws[0]), Phase("on", "mine", laws[1])])
    with pytest.raises(ScenarioFaults, match=r"controller\.rate_rad_s is 'of the base' here and 'of the arm' in phase 'go'"):
        refuse_telemetry([Phase("go", "mine", laws[0]), Phase("hold", "yours", laws[2])])


def test_names_with_equal_default_json_names_stay_different():
    """j1 and j_1 have the same default JSON name in protobuf, and its readers refuse such a schema."""
    from google.protobuf import descriptor_pb2, descriptor_pool

    signals = (Signal("state", "time_s", "s", ""), *(Signal("state", f"q_{j}_rad", "rad", "") for j in ("j1", "j_1")))
    schema = sample_schema(Layout(signals))
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    assert pool.FindMessageTypeByName("ffsm.State").fields_by_name.keys() == ["time_s", "q_j1_rad", "q_j_1_rad"]


@pytest.mark.parametrize("names", [("a_m",), ("time_s", "a_m", "a_m")])
def test_a_log_without_time_or_with_a_name_twice_is_refused(names):
    schema = sample_schema(Layout(tuple(Signal("state", name, "", "") for name in names)))
    with pytest.raises(ValueError, match="no time, or two fields of the same name"):
        layout_of_schema(schema, {})
    assert TIME == "state.time_s"
