"""Schemas in ``run.mcap`` compared with those in Foxglove's SDK."""

from __future__ import annotations

import foxglove.messages as sdk
import pytest
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from ffsm_mj.log.foxglove import descriptor_set, viewer_topics
from ffsm_mj.records.kinds import kinds

MESSAGES = sorted({*viewer_topics(kinds()).values(), PointCloud}, key=lambda message: message.DESCRIPTOR.full_name)


def shape_of(data):
    """Messages and enumerations of a set of descriptors: field numbers, types and names."""
    found = {}
    for file in FileDescriptorSet.FromString(data).file:
        for message in file.message_type:
            name = f"{file.package}.{message.name}"
            found[name] = {f.number: (f.name, f.type, f.label, f.type_name.rpartition(".")[2]) for f in message.field}
            for values in message.enum_type:
                found[f"{name}.{values.name}"] = {value.number: value.name for value in values.value}
    return found


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.DESCRIPTOR.name)
def test_schemas_are_those_of_the_sdk(message):
    name = message.DESCRIPTOR.name
    theirs = getattr(sdk, name).get_schema()
    assert (theirs.name, theirs.encoding) == (message.DESCRIPTOR.full_name, "protobuf")
    ours, published = shape_of(descriptor_set(message)), shape_of(theirs.data)
    assert ours[f"foxglove.{name}"]
    for each, fields in ours.items():
        assert {number: published[each].get(number) for number in fields} == fields
