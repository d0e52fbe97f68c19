"""Entry point of ``ffsm``: dispatch of commands and their exit codes. Slow imports are deferred to where they are used."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext

from ffsm_mj.assembly.process import raised
from ffsm_mj.cli.command_line import HelpRequest, parse, parser
from ffsm_mj.cli.exit_codes import BAD_INPUT, INTERRUPTED, OK, OUTPUT_LOST, RUN_FAILED
from ffsm_mj.cli.standard_streams import Output, complain, secure
from ffsm_mj.invocation import command_line
from ffsm_mj.module_path import without_current_folder

_SHOW_TRACEBACK = "FFSM_TRACEBACK"
"""Environment variable: unhandled exceptions are raised instead of reported in one line."""
_READERS = ("analyze", "export", "view", "fit", "campaign", "new")
"""Commands that read files of unknown origin."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    secure()
    output = Output()
    with command_line():
        try:
            code = _perform(sys.argv[1:] if arguments is None else arguments, output)
        except Exception as error:
            if _is_interrupt(error):
                complain("interrupted")
                return INTERRUPTED
            if os.environ.get(_SHOW_TRACEBACK):
                raise
            code = _internal_error(error)
        if output.lost:
            complain(f"stdout: output is lost ({output.lost})")
            return code or OUTPUT_LOST
    return code


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an exception: where a class is made, as during imports, Python raises another one for it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _internal_error(error: Exception) -> int:
    """Report an unhandled exception in one line; Python's own exit code for it, 1, would mean a failed check here."""
    from ffsm_mj.errors import described, raised_at

    complain(f"internal_error: {described(error)}{raised_at(error)}; {_SHOW_TRACEBACK}=1 shows the traceback")
    return RUN_FAILED


def one_blas_thread() -> None:
    """Limit BLAS to one thread in this process and its children; must be called before numpy is imported.

    For runs from a user's own process see :mod:`ffsm_mj.assembly.process`.
    """
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")


@contextmanager
def _quiet_libraries() -> Iterator[None]:
    """Keep warnings of NumPy, Matplotlib, MuJoCo and other libraries from stderr; faults have messages of our own."""
    import numpy as np

    from ffsm_mj.model.mujoco_process import collected_warnings

    nobody = logging.NullHandler()  # without a handler, logging writes to stderr itself
    logging.getLogger().addHandler(nobody)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"), collected_warnings([]):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.getLogger().removeHandler(nobody)


def _perform(arguments: Sequence[str], output: Output) -> int:
    """Perform the command; report errors in one line per fault."""
    from ffsm_mj.errors import FfsmError, InputError, LogWriteError, OutputLostError

    one_blas_thread()
    try:
        with raised(), without_current_folder():
            options = parse(arguments)
            with _quiet_libraries() if options.command in _READERS else nullcontext():
                return _implementation(options.command)(options, output)
    except HelpRequest as asked:
        output.say(str(asked))
        return OK
    except InputError as error:
        for line in error.lines:
            complain(line)
    except LogWriteError as error:
        complain(f"write_failed: {error}")
        return RUN_FAILED
    except OutputLostError as error:
        complain(str(error))
        return OUTPUT_LOST
    except FfsmError as error:
        complain(str(error))
    except OSError as error:  # a name that is too long, a folder that cannot be entered
        complain(": ".join(str(part) for part in (error.filename, error.strerror or error) if part))
    except KeyboardInterrupt:
        complain("interrupted")
        return INTERRUPTED
    return BAD_INPUT


def _implementation(command: str | None) -> Callable[[argparse.Namespace, Output], int]:  # noqa: PLR0912 (a table)
    """Function of a command; its module is imported when the command is performed."""
    match command:
        case "run":
            from ffsm_mj.cli.run import run as perform
        case "check":
            from ffsm_mj.cli.check import check as perform
        case "analyze":
            from ffsm_mj.cli.analyze import analyze as perform
        case "export":
            from ffsm_mj.cli.export import export as perform
        case "view":
            from ffsm_mj.cli.view import view as perform
        case "impact-map":
            from ffsm_mj.cli.impact_map import impact_map as perform
        case "sensitivity":
            from ffsm_mj.cli.sensitivity import sensitivity as perform
        case "fit":
            from ffsm_mj.cli.measured import fit as perform
        case "campaign":
            from ffsm_mj.cli.campaign import campaign as perform
        case "validate":
            from ffsm_mj.cli.validate import validate as perform
        case "fmu":
            from ffsm_mj.cli.fmu import fmu as perform
        case "schema":
            from ffsm_mj.cli.check import schema as perform
        case "new":
            from ffsm_mj.cli.generate import new as perform
        case "new-law":
            from ffsm_mj.cli.generate import new_law as perform
        case "completion":
            from ffsm_mj.cli.completion import completion as perform
        case _:
            perform = _usage
    return perform


def _usage(options: argparse.Namespace, output: Output) -> int:
    if not options.version:
        output.say(parser().format_help().rstrip())
        return OK
    from importlib.metadata import version

    from ffsm_mj._core import BUILT

    output.say(f"ffsm-mj {version('ffsm-mj')}, core for {BUILT}")
    return OK


if __name__ == "__main__":
    sys.exit(main())
