"""One root error; the leaves take data, write the message themselves and list the names that would have been right."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from sysconfig import get_path
from traceback import FrameSummary, extract_tb

from ffsm_mj.installation import add_extra, build_again
from ffsm_mj.similar_names import did_you_mean, most_similar_first

_LONGEST_TEXT = 300
_LONGEST_LIST = 20
"""Names that a message lists whole, such as the kinds of control laws; of more it lists the most similar ones."""
_MOST_NAMES = 10
_OURS = (Path(__file__).parent, Path(__file__).parents[1] / "controllers")
"""This package, and the control laws beside it in a checkout; installed, they are among the libraries."""
_LIBRARIES = tuple(map(Path, (get_path("stdlib"), get_path("purelib"), get_path("platlib"))))
THE_LOG = "the log"
"""How a message begins where what raises it has no name for its log; :func:`working_on` puts the name there."""


class FfsmError(Exception):
    """Root of every error that ffsm-mj raises on purpose."""


class ScenarioNote(UserWarning):
    """What a user should know about a scenario before it runs; ``ffsm check`` prints it."""


@dataclass(frozen=True)
class Fault:
    """One thing wrong with the input.

    Attributes:
        message: What is wrong and what is allowed.
        path: Keys and list positions that lead to it in the scenario, outermost first.
        raised: The exception of a plug-in that the message reports.
    """

    message: str
    path: tuple[str | int, ...] = ()
    raised: Exception | None = None


class InputError(FfsmError):
    """Bad input: a scenario, a model, a file or an argument. One line per fault; the CLI exits with 2.

    Attributes:
        lines: The lines.
        overrides: The override, ``key=value``, of which each line is a fault; empty texts without one.
    """

    def __init__(self, lines: str | Sequence[str], overrides: Sequence[str] = ()) -> None:
        self.lines: tuple[str, ...] = tuple(map(one_line, (lines,) if isinstance(lines, str) else lines))
        self.overrides = tuple(overrides) or ("",) * len(self.lines)
        super().__init__("\n".join(self.lines))


class ScenarioFaults(FfsmError):
    """Faults of a scenario by key, before the file and line they stand on are known."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(f.message for f in faults))


class Faults:
    """Collects the faults of a scenario by key. A context manager: leaving it raises them together, if there are any."""

    def __init__(self) -> None:
        self.collected: list[Fault] = []

    def add(self, message: str, *path: str | int) -> None:
        """Add a fault at some keys."""
        self.collected.append(Fault(message, path))

    @contextmanager
    def below(self, *path: str | int, prefix: str = "") -> Iterator[None]:
        """Context whose faults are added below some keys; an unknown name is a fault of these keys."""
        try:
            yield
        except ScenarioFaults as error:
            self.collected += [
                replace(fault, message=prefix + fault.message, path=(*path, *fault.path)) for fault in error.faults
            ]
        except LookupError as error:
            self.collected.append(Fault(f"{prefix}{error.args[0]}", path))

    def __enter__(self) -> Faults:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self.collected:
            raise ScenarioFaults(self.collected)


@contextmanager
def faults_below(*path: str | int) -> Iterator[None]:
    """Context whose faults are raised below some keys; an unknown name is a fault of these keys.

    Raises:
        ScenarioFaults: There are any.
    """
    with Faults() as faults, faults.below(*path):
        yield


def raised_by_plugin(error: BaseException | None) -> Exception | None:
    """The exception of a plug-in from which an error follows, with its traceback; None if it follows from none."""
    while error is not None:
        faults = error.faults if isinstance(error, ScenarioFaults) else ()
        collected = next((fault.raised for fault in faults if fault.raised is not None), None)
        if collected is not None:
            return collected
        error = error.__cause__
    return None


class LogError(FfsmError):
    """A log that cannot be read, or holds no run."""

    def __init__(self, path: Path | str, reason: str) -> None:
        self.path = Path(path)
        super().__init__(f"{path}: {reason}")


class LogWriteError(FfsmError):
    """The log could not be written (full disk, closed pipe); what was flushed before stays readable."""

    def __init__(self, path: Path | str, cause: OSError) -> None:
        self.path, self._cause = Path(path), cause
        super().__init__(f"{path}: {cause.strerror or cause}")

    def __reduce__(self) -> tuple[type[LogWriteError], tuple[Path, OSError], dict[str, object]]:
        """What makes it again in another process."""
        return LogWriteError, (self.path, self._cause), vars(self)


class OutputLostError(FfsmError):
    """A file that was asked for could not be written to its end (full disk)."""

    def __init__(self, path: Path | str, reason: str) -> None:
        self.path = Path(path)
        super().__init__(f"{path}: output is lost ({reason})")


class UnknownSensorError(FfsmError, KeyError):
    """A sensor that no model has; the message lists the sensors that there are, of many the most similar ones."""

    def __init__(self, name: object, sensors: Iterable[str]) -> None:
        names = tuple(sensors)
        known = f"the sensors are {_listed(str(name), names)}" if names else "the models have no sensors"
        super().__init__(f"unknown sensor {str(name)!r}{did_you_mean(str(name), names)}; {known}")

    __str__ = Exception.__str__  # that of KeyError puts the message in quotes


class ControllerError(FfsmError):
    """A controller raised or returned something that no actuator can follow."""


class MissingPackageError(FfsmError):
    """A package that only some functions need is not installed; the message says what to install."""

    def __init__(self, purpose: str, package: str, extra: str) -> None:
        self.package = package
        super().__init__(f"{purpose} needs the package {package}; install it by: {add_extra(extra, package)}")


class CoreError(FfsmError):
    """The compiled core cannot be used; the message says how to build it again."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"the compiled core of ffsm-mj cannot be used ({reason}); build it again: {build_again()}")


class UnsupportedContactError(FfsmError):
    """A contact that the impact laws cannot resolve exactly; the run ends rather than guess."""


def one_line(text: str) -> str:
    """A text with everything escaped that is no printable character: line ends, colours of a terminal, half characters."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode("ascii") for c in text)


def plural(number: int, noun: str) -> str:
    """A number with its noun: ``1 impact``, ``2 impacts``; irregular plurals are the caller's."""
    return f"{number} {noun}{'s' * (number != 1)}"


def first_few(names: Sequence[str], most: int = 4) -> str:
    """The first of some names, and how many more there are; one more has room."""
    if len(names) <= most + 1:
        return ", ".join(names)
    return f"{', '.join(names[:most])} and {len(names) - most} more"


def printable(text: str) -> str:
    """Lines with everything escaped that a terminal could take for more than text; the line ends stay."""
    return text if text.replace("\n", "").isprintable() else "\n".join(map(one_line, text.split("\n")))


def described(error: BaseException) -> str:
    """Kind and text of an exception of someone else's code, on one line that can be printed and logged whatever it says."""
    try:
        text = one_line(" ".join(str(error).split()))
    except Exception:  # noqa: BLE001 (its text is its author's code too)
        text = ""
    shown = text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]}..."
    return f"{type(error).__name__}: {shown}" if shown else type(error).__name__


@contextmanager
def working_on(place: Path | str) -> Iterator[None]:
    """Turn any exception that a file's content causes into one line that names the file.

    Readers refuse what they know to be wrong with messages of their own. This stands behind them: no list of what a file can
    do to the libraries that work on it is complete, and a traceback says nothing about the file.

    Raises:
        InputError: Something was raised that is no error of ours, of the operating system, or an interruption.
    """
    try:
        yield
    except InputError as error:
        if not any(line.startswith(THE_LOG) for line in error.lines):
            raise
        named = [f"log {place}{line[len(THE_LOG) :]}" if line.startswith(THE_LOG) else line for line in error.lines]
        raise InputError(named) from error
    except (FfsmError, OSError):
        raise
    except Exception as error:
        raise InputError(f"{place}: cannot be used ({described(error)}{raised_at(error)})") from error


def raised_at(error: BaseException) -> str:
    """`` (file:line)`` of :func:`raised_in`; empty where there is none."""
    frame = raised_in(error)
    return f" ({Path(frame.filename).name}:{frame.lineno})" if frame is not None else ""


def raised_in(error: BaseException) -> FrameSummary | None:
    """Frame that a user wants to see of an exception: the innermost one of his code, or else of this package.

    What his code calls, here or in a library, fails by what it was given: a wrong name of a sensor is a mistake of the law
    that asks for it. None if the exception passed through libraries only.
    """
    frames = [f for f in extract_tb(error.__traceback__) if f.lineno and not f.filename.startswith("<frozen ")]
    inside = [f for f in frames if any(home in Path(f.filename).parents for home in _OURS)]
    return next(iter(([f for f in frames if _is_users(f.filename)] or inside)[::-1]), None)


def written_at(method: Callable[..., object]) -> str:
    """`` (file:line)`` of a method of the user's code; empty for one of this package or of a library."""
    code = getattr(method, "__code__", None)
    return f" ({Path(code.co_filename).name}:{code.co_firstlineno})" if code and _is_users(code.co_filename) else ""


def _is_users(file: str) -> bool:
    """Whether a file is part of neither this package nor a library."""
    return not any(home in Path(file).parents for home in (*_OURS, *_LIBRARIES))


def unknown_name(kind: str, name: str, valid: Iterable[str]) -> str:
    """Sentence for a name that is not there: what it was meant to be, and the names that exist, of many the most similar."""
    names = set(valid)
    allowed = _listed(name, names) if names else f"none, the model has no {kind}"
    return f"unknown {kind} {name!r}{did_you_mean(name, names)}; allowed: {allowed}"


def _listed(name: str, valid: Collection[str]) -> str:
    """Names by alphabet, or the most similar ones to a name first and the number of all others."""
    if len(valid) <= _LONGEST_LIST:
        return ", ".join(sorted(valid, key=str.lower))
    return first_few(most_similar_first(name, valid), _MOST_NAMES)


def full_name(kind: str, name: str, names: Iterable[str]) -> str:
    """Full name of an element of a model; the prefix may be left out if the rest of the name is unique.

    Raises:
        LookupError: No such element, or more than one; the message lists the valid names.
    """
    names = tuple(names)
    matches = names_like(name, names)
    if name in matches:
        return name
    if len(matches) > 1:
        raise LookupError(f"{kind} {name!r} is ambiguous; write one of {', '.join(matches)}")
    if not matches:
        raise LookupError(unknown_name(kind, name, names))
    return matches[0]


def names_like(name: str, names: Iterable[str]) -> list[str]:
    """The full names that a name may mean, with the prefix of a model or without it."""
    return [full for full in names if name in (full, full.partition("/")[2])]
