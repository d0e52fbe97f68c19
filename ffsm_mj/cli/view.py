"""Implementation of ``ffsm view``: open a run, or a scenario at t = 0, in the Rerun viewer."""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

from ffsm_mj.cli.exit_codes import OK, RUN_FAILED
from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.errors import InputError, unknown_name, working_on
from ffsm_mj.invocation import command
from ffsm_mj.log.rerun.viewer import has_display, viewer_command
from ffsm_mj.log.run_folder import RECORDING, find_log, finished_recording, holds_log
from ffsm_mj.report.output_place import new_file, usable_file
from ffsm_mj.scenario.shipped import scenario_names, scenario_path

LATEST = "logs/latest"


def view(options: argparse.Namespace, output: Output) -> int:
    """Open a recording of a run or of a scenario at t = 0, or save it; returns the exit code.

    The argument is the path of a run if there is one, else a scenario file, else the name of a shipped scenario.

    Raises:
        InputError: It is none of them, the log cannot be read, or the scenario is invalid.
        OutputLostError: The recording could not be saved.
    """
    run, scenario = _run_of(options.scene), ""
    if run is None:
        scenario = _scenario_of(options.scene)
    elif options.overrides:
        raise InputError(f"ffsm view: -s has no effect on {options.scene}, a run; name a scenario to change it")
    if options.save is None and not has_display():
        complain(_without_display(run, options.scene))
        return RUN_FAILED
    recording = finished_recording(run) if run is not None else None
    with tempfile.TemporaryDirectory(prefix="ffsm-") as folder:
        target = recording or Path(folder) / RECORDING
        if options.save is not None:
            usable_file(Path(options.save))
        if recording is None:
            _record(run, scenario, options.overrides, target, output)
        if options.save is None:
            return _open_viewer(target, options.listen)
        with new_file(Path(options.save)) as place:
            place.write_bytes(target.read_bytes())
    output.say(f"recording: {options.save}")
    return OK


def _run_of(name: str) -> Path | None:
    """Path of a run, if it is one: its folder or its log."""
    path = Path(name)
    if name == LATEST:
        find_log(path)  # its message says how to make a run
    return path if holds_log(path) else None


def _scenario_of(name: str) -> str:
    """A scenario file or the name of a shipped scenario.

    Raises:
        InputError: It is neither; the message says what was tried.
    """
    path = Path(name)
    if path.exists() or name in scenario_names():
        scenario_path(name)
        return name
    shipped = unknown_name("shipped scenario", name, scenario_names())
    raise InputError(f"{name}: no run folder or log, no scenario file, and {shipped}")


def _without_display(run: Path | None, name: str) -> str:
    if run is not None:
        kept = finished_recording(run) or find_log(run)
        return f"no display for the Rerun viewer; open {kept} on a machine that has one"
    saved = command("view", name, "--save", "scene.rrd")
    return f"no display for the Rerun viewer; '{saved}' writes a recording for another machine"


def _record(run: Path | None, scenario: str, overrides: list[str], path: Path, output: Output) -> None:
    """Write the recording of a run from its log, or of a scenario at t = 0."""
    if run is None:
        from ffsm_mj.assembly.notes import initial_scene
        from ffsm_mj.assembly.prepare import prepare
        from ffsm_mj.log.rerun.initial_scene import write_initial_scene

        with output.progress() as stage:
            stage(f"compile {scenario}")
            prepared = prepare(scenario, overrides)
            write_initial_scene(initial_scene(prepared.assemble(), prepared.describe()), path)
        return
    from ffsm_mj.analysis.run import load_run
    from ffsm_mj.log.rerun.sink import write_recording

    log = find_log(run)
    with output.progress() as stage, working_on(log):
        stage(f"recording of {log}")
        write_recording(load_run(log).log, path)


def _open_viewer(recording: Path, listen: str) -> int:
    if subprocess.call(viewer_command(str(recording.absolute()), listen=listen)) == 0:
        return OK
    complain("the Rerun viewer did not open; see its message above")
    return RUN_FAILED
