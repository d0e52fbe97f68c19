"""Numbers as MCAP and protobuf write them."""

from __future__ import annotations


def nanoseconds(time_s: float) -> int:
    """Simulation time as MCAP's integer ``log_time``."""
    return round(time_s * 1e9)


def varint(value: int) -> bytes:
    """A whole number as protobuf writes it."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
