"""A run as a self-contained HTML page: 3D scene with a time slider, plots and checks; it needs no network."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import MissingPackageError
from ffsm_mj.report.output_place import new_file, usable_file
from ffsm_mj.report.plots.subject import Subject

__all__ = ["write_page"]


@np.errstate(all="ignore")  # a log may hold any double
def write_page(run: Run, path: Path) -> str:
    """Write a run as a page.

    Args:
        run: A run with at least one sample.
        path: The file.

    Returns:
        One line that describes the output.

    Raises:
        InputError: No samples, models that no longer compile, or a file that cannot be written.
        MissingPackageError: K3D, which draws the scene, is not installed.
        OutputLostError: The file could not be written completely.
    """
    try:
        import k3d  # noqa: F401
    except ImportError as error:
        raise MissingPackageError("--html", "k3d", "html") from error
    from ffsm_mj.report.page.document import document
    from ffsm_mj.report.page.scene import picked_times, poses, scene

    usable_file(path)
    subject = Subject(run, picked_times(run).tolist())
    picked = poses(subject)
    drawn = scene(subject, picked)
    page = document(run, drawn, picked).encode()
    with new_file(path) as place:
        place.write_bytes(page)
    return f"{picked.description}, {len(page) / 1e6:.1f} MB"
