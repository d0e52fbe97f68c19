"""Folder of a study: the study file, its metrics file, and the folder of a campaign for each variant."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ffsm_mj.campaign.storage.exclusive import LOCK, exclusive, is_unfinished, write_whole
from ffsm_mj.errors import InputError
from ffsm_mj.invocation import option
from ffsm_mj.report.output_place import refuse_link
from ffsm_mj.scenario.faults import KindNames, plain_faults
from ffsm_mj.scenario.source import source_of
from ffsm_mj.similar_names import similar_file
from ffsm_mj.studies.config import StudyFile
from ffsm_mj.yaml.parser import read_node, write_yaml

STUDY, RECORD, METRICS, VARIANTS = "study.yaml", "study.json", "metrics.py", "variants"
_FORMAT = 1
_OURS = (LOCK, STUDY, RECORD, METRICS, VARIANTS)


@dataclass(frozen=True)
class StudyRecord:
    """What a folder holds besides the study file.

    Attributes:
        not_applicable: Why the control laws of a variant cannot be created for its scenario, by name of the variant.
        metrics: Names of metrics that are functions of the caller.
        metrics_file: Name of the Python file that defines them, whose copy is in the folder; empty for those of a script.
    """

    not_applicable: Mapping[str, str]
    metrics: tuple[str, ...]
    metrics_file: str


class StudyFolder:
    """File names and files of a study.

    Attributes:
        path: The folder.
    """

    def __init__(self, path: Path) -> None:
        """Store the path; nothing is created."""
        self.path = path

    @property
    def is_initialized(self) -> bool:
        """Whether the folder holds a study: the record is written after everything else."""
        return (self.path / RECORD).is_file()

    def variant(self, name: str) -> Path:
        """Folder of the campaign of a variant."""
        return self.path / VARIANTS / name

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Context with exclusive access; see :func:`~ffsm_mj.campaign.storage.exclusive.exclusive`.

        Raises:
            InputError: Another process runs this study, the folder cannot be created, or a part of it is a symbolic link.
        """
        variants = self.path / VARIANTS
        for path in (*(self.path / name for name in _OURS), *(variants.iterdir() if variants.is_dir() else ())):
            refuse_link(path)
        with exclusive(self.path, "study"):
            yield

    def refuse_other_files(self) -> None:
        """Refuse a folder that holds anything but a study.

        Raises:
            InputError: It holds another file.
        """
        names = sorted(each.name for each in self.path.iterdir())
        others = [name for name in names if name not in _OURS and not is_unfinished(name, _OURS)]
        if others and not self.is_initialized:
            raise InputError(f"{self.path}: holds {others[0]} but no study; choose another {option('out')}")

    def write(self, config: StudyFile, record: StudyRecord, metrics: str) -> None:
        """Write the files of a study; the record comes last and marks the folder as complete.

        Args:
            config: The study file.
            record: What the folder holds besides it.
            metrics: Content of the metrics file; empty if there is none. The copy is a record; it is never executed.

        Raises:
            LogWriteError: A file cannot be written (full disk).
        """
        if record.metrics_file:
            write_whole(self.path / METRICS, metrics.encode())
        write_whole(self.path / STUDY, write_yaml(config.model_dump(mode="json", exclude_none=True)).encode())
        write_whole(self.path / RECORD, json.dumps({"format": _FORMAT} | asdict(record), indent=1).encode())

    def config(self) -> StudyFile:
        """Read the study file.

        Raises:
            InputError: There is none, or it is invalid.
        """
        file = self.path / STUDY
        if not file.is_file():
            there = self.path.is_dir()
            what = f"holds no study (no {STUDY})" if there else f"no such study folder{similar_file(self.path)}"
            raise InputError(f"{self.path}: {what}")
        source = source_of(read_node(file, "study"), file)
        try:
            return StudyFile.model_validate(source.data)
        except ValidationError as error:
            raise InputError(source.lines(plain_faults(error, KindNames(StudyFile, (), (), {})))) from error

    def record(self) -> StudyRecord:
        """Read what the folder holds besides the study file.

        Raises:
            InputError: It cannot be read.
        """
        file = self.path / RECORD
        try:
            return _record(json.loads(file.read_text(encoding="utf-8")))
        except OSError as error:
            raise InputError(f"{self.path}: holds no complete study (no {RECORD}); run it again with its file") from error
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(f"{file}: is not the record of a study ({type(error).__name__}: {error})") from error


def _record(data: Any) -> StudyRecord:
    if data["format"] != _FORMAT:
        raise ValueError(f"format {data['format']}; this version reads {_FORMAT}")
    reasons, metrics, file = data["not_applicable"], data["metrics"], data["metrics_file"]
    texts = [*reasons.keys(), *reasons.values(), *metrics, file]
    if not all(isinstance(text, str) for text in texts):
        raise TypeError("a name or reason is not a text")
    return StudyRecord(dict(reasons), tuple(metrics), file)
