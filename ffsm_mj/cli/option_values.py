"""Values of options, from their text on the command line; a wrong one is refused with what it should be."""

from __future__ import annotations

import argparse
from ipaddress import ip_address

from ffsm_mj.report.frame_rate import MOST_FRAMES_PER_SECOND


def address(text: str) -> str:
    """An IP address."""
    try:
        return str(ip_address(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text} is not an IP address, e.g. 192.168.0.5, or 0.0.0.0 for all") from error


def tolerance(text: str) -> tuple[str, float]:
    """Name of a check, empty for all checks, and its tolerance."""
    name, _, value = text.rpartition("=")
    return name.replace("_", " ").strip(), positive(value)


def seconds_or_off(text: str) -> float:
    """A positive time in s; 0 for ``off``."""
    return 0.0 if text == "off" else positive(text)


def frame_rate(text: str) -> float:
    """Frames per second that an animation can have."""
    if positive(text) > MOST_FRAMES_PER_SECOND:
        raise argparse.ArgumentTypeError(f"{text} is more than {MOST_FRAMES_PER_SECOND} frames per second")
    return float(text)


def positive(text: str) -> float:
    """A positive, finite number."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value
