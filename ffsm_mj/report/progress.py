"""Progress of runs in scripts and notebooks: a line on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

_SHOWN_EVERY_S = 0.2
_LINE_EVERY_S = 30.0


def progress(name: str = "") -> Callable[[float, float], None]:
    """What the argument ``report`` of :func:`ffsm_mj.run`, ``sweep``, ``Campaign.run``, ``impact_map`` and others may be.

    A line with the share done and the time left, five times a second on a terminal and in a notebook; elsewhere, as in the
    log of a batch job, a new line every 30 s. Each use begins anew::

        ffsm_mj.run("baseline", report=ffsm_mj.progress("baseline"))

    Args:
        name: What the line begins with.
    """
    begun = time.monotonic()
    first, due, width = None, begun, 0
    rewritten = sys.stderr.isatty() or type(sys.stderr).__module__.startswith("ipykernel.")

    def report(done: float, total: float) -> None:
        nonlocal first, due, width
        now = time.monotonic()
        first = done if first is None else first  # a campaign that goes on begins with what there is
        if now < due and done < total:
            return
        due = now + (_SHOWN_EVERY_S if rewritten else _LINE_EVERY_S)
        share = done / total if total > 0.0 else 1.0
        left = f", {(total - done) * (now - begun) / (done - first):.0f} s left" if first < done < total else ""
        text = f"{name}{': ' * bool(name)}{done:.4g} of {total:.4g} ({share:.0%}), {now - begun:.0f} s{left}"
        end = "\n" if done >= total or not rewritten else ""
        print(f"{chr(13) * rewritten}{text:<{width}}", end=end, file=sys.stderr, flush=True)
        width = len(text)  # the rest of a longer line is overwritten

    return report
