"""The log: encoding according to its schema, readable by other programs and after a kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.contact_models.impact.records import IMPACT
from ffsm_mj.errors import InputError, LogError
from ffsm_mj.log.mcap import format as form
from ffsm_mj.log.mcap.format import decode_record, encode_record
from ffsm_mj.records.events import OutcomeRecord, PhaseRecord, UnhandledContactRecord
from ffsm_mj.records.kinds import kind_of
from ffsm_mj.records.signals import Layout, Signal
from tests.scenes import two_balls

LAYOUT = Layout(
    (
        Signal("state", "time_s", "s", "time"),
        *(Signal("state", f"x{i}", "m", "a coordinate") for i in range(40)),  # field numbers above 15 take two bytes
        Signal("energy", "total_J", "J", "energy"),
        Signal("phase", "index", "", "phase"),
    )
)


def test_samples_are_decoded_by_protobuf(rng):
    """The block encoder against Google's decoder: all values, including zeros and NaN."""
    rows = rng.normal(size=(50, len(LAYOUT.signals)))
    rows[3, 4], rows[5, 6], rows[7, 8] = 0.0, np.nan, -np.inf
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(form.sample_schema(LAYOUT)).file:
        pool.Add(file)
    sample = message_factory.GetMessageClass(pool.FindMessageTypeByName(form.SAMPLE_SCHEMA))
    messages = form.SampleCodec(LAYOUT).encode(rows)
    for row, data in zip(rows, messages, strict=True):
        message = sample.FromString(data.tobytes())
        values = [getattr(getattr(message, s.group), s.name) for s in LAYOUT.signals]
        np.testing.assert_array_equal(values, row)


def test_samples_survive_the_round_trip(rng):
    rows = rng.normal(size=(50, len(LAYOUT.signals)))
    codec = form.SampleCodec(LAYOUT)
    np.testing.assert_array_equal(codec.decode(codec.encode(rows)), rows)
    units = {s.key: f"{s.unit} | {s.description}" for s in LAYOUT.signals}
    assert form.layout_of_schema(form.sample_schema(LAYOUT), units) == LAYOUT


def test_decoder_refuses_messages_of_another_layout(rng):
    codec = form.SampleCodec(LAYOUT)
    messages = codec.encode(rng.normal(size=(3, len(LAYOUT.signals))))
    with pytest.raises(ValueError, match="size"):
        codec.decode(messages[:, :-1])
    messages[1, 0] ^= 8
    with pytest.raises(ValueError, match="fields"):
        codec.decode(messages)


def test_decoding_some_columns_equals_decoding_all(rng):
    rows = rng.normal(size=(50, len(LAYOUT.signals)))
    codec = form.SampleCodec(LAYOUT)
    np.testing.assert_array_equal(codec.decode(codec.encode(rows), [41, 0, 7]), rows[:, [41, 0, 7]])


@pytest.mark.parametrize(
    "record",
    [
        PhaseRecord(1, "pause", "off", 7.5, "impact"),
        UnhandledContactRecord(("a", "b"), 0.5, 1.25, 1e-3),
        OutcomeRecord("completed", "", 30.0, 30000, 1.5, 30001, {"approach": {"n": 2, "worst": 1e-14}}, {"mujoco": "4.0.0"}),
    ],
)
def test_events_survive_the_round_trip(record):
    assert decode_record(kind_of(record), encode_record(record)) == record


def test_impact_survives_the_round_trip(tmp_path):
    (impact,) = ffsm_mj.run(two_balls(tmp_path)).impacts
    assert decode_record(IMPACT, encode_record(impact)) == impact


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished")
    run = ffsm_mj.run(two_balls(folder), out=folder / "out", rerun=False)
    return folder / "out", run


def test_a_log_is_readable_with_the_mcap_package_alone(finished):
    """By the names in the documentation."""
    folder, run = finished
    with (folder / "run.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        energies, impulse = [], None
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=["/ffsm/sample", "/ffsm/impact"]):
            if channel.topic == "/ffsm/sample":
                assert message.log_time == round(decoded.state.time_s * 1e9)
                energies.append(decoded.energy.total_J)
            else:
                impulse = decoded.impulse_N_s
                assert list(decoded.qvel_after["target/x"].values) == [run.impacts[0].qvel_after["target/x"][0]]
        attachments = {a.name: a.data for a in reader.iter_attachments()}
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    np.testing.assert_array_equal(energies, run["energy.total_J"])
    assert impulse == run.impacts[0].impulse_N_s
    assert set(attachments) == {"scenario.yaml", "mjcf/robot/robot.xml", "mjcf/target/target.xml"}
    assert attachments["scenario.yaml"].decode() == (folder / "scenario.yaml").read_text()
    assert metadata["ffsm.signals"]["energy.total_J"].startswith("J | ")
    assert metadata["ffsm.run"]["version mujoco"]


def test_a_file_that_is_not_a_log_is_refused(tmp_path):
    (tmp_path / "x.mcap").write_bytes(b"hello")
    with pytest.raises(LogError, match="not an MCAP file"):
        ffsm_mj.load_run(tmp_path / "x.mcap")
    with pytest.raises(InputError, match=r"contains no run\.mcap"):
        ffsm_mj.load_run(tmp_path)
    with pytest.raises(InputError, match="no such run"):
        ffsm_mj.load_run(tmp_path / "nothing")


def start_run(folder, *arguments):
    """Start ``ffsm run`` of ten minutes in a process; return when its log exists."""
    command = [sys.executable, "-m", "ffsm_mj.cli.main", "run", "baseline", "-s", "duration_s=600", "--no-rerun"]
    process = subprocess.Popen(
        [*command, "--out", str(folder), *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    log = folder / "run.mcap.partial"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not (log.exists() and log.stat().st_size > 150_000):
        time.sleep(0.05)
    return process


def test_a_killed_run_is_readable(tmp_path):
    process = start_run(tmp_path / "out")
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    read = ffsm_mj.load_run(tmp_path / "out")
    assert read.outcome == "incomplete"
    assert len(read.time) > 100
    assert [p.name for p in read.phases][:1] == ["approach"]
    assert all(check.passes for check in all_checks(read))
