"""Values of arguments: from the text of one to what it stands for; ``ArgumentTypeError`` if it stands for nothing."""

from __future__ import annotations

import argparse
from ipaddress import ip_address

from ffsm_mj.report import MOST_FRAMES_PER_SECOND


def whole(text: str) -> int:
    """An integer, not negative."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is not an integer")
    return int(text)


def at_least_one(text: str) -> int:
    """A positive integer."""
    if whole(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is less than 1")
    return int(text)


def outcomes(text: str) -> tuple[str, ...]:
    """Outcomes of runs that are repeated on request, separated by commas."""
    from ffsm_mj.experiments.store import RETRIED  # slow to import

    names = tuple(text.split(","))
    for name in names:
        if name not in RETRIED:
            raise argparse.ArgumentTypeError(f"{name!r} is not one of {', '.join(RETRIED)}")
    return names


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


def instant(text: str) -> tuple[str, float]:
    """Run folder and instant, s, of ``--from RUN@TIME``."""
    run, _, time_s = text.rpartition("@")
    if not (run and time_s):
        raise argparse.ArgumentTypeError(f"{text} is not RUN@TIME, such as logs/cap@50")
    return run, positive(time_s)


def positive(text: str) -> float:
    """A positive, finite number."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value
