"""Implementation of ``ffsm view``: open a run in the Rerun viewer."""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

from ffsm_mj.cli.exit_codes import OK, RUN_FAILED
from ffsm_mj.cli.progress import progress
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import working_on
from ffsm_mj.log.rerun.viewer import has_display, viewer_command
from ffsm_mj.log.run_folder import RECORDING, find_log, finished_recording


def view(options: argparse.Namespace, _: Output) -> int:
    """Open the recording of a run, which is made from the log if there is none; returns the exit code.

    Raises:
        InputError: There is no such run, or its log cannot be read.
    """
    log = find_log(Path(options.run))
    recording = finished_recording(Path(options.run))
    if not has_display():
        complain(f"no display for the Rerun viewer; open {recording or log} on a machine that has one")
        return RUN_FAILED
    if recording is not None:
        return _open_viewer(recording, options.listen)
    from ffsm_mj.log.rerun.from_log import write_recording
    from ffsm_mj.report.run import load_run

    with tempfile.TemporaryDirectory(prefix="ffsm-") as folder:
        made = Path(folder) / RECORDING
        with progress() as shown, working_on(log):
            shown.stage(f"recording of {log}")
            write_recording(load_run(log).log, made)
        return _open_viewer(made, options.listen)


def _open_viewer(recording: Path, listen: str) -> int:
    if subprocess.call(viewer_command(str(recording.absolute()), listen=listen)) == 0:
        return OK
    complain("the Rerun viewer did not open; see its message above")
    return RUN_FAILED
