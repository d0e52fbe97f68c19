"""Folder of a campaign: files that are written whole, one process at a time; settings that its rows belong to."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Literal

from filelock import FileLock, Timeout
from pydantic import TypeAdapter, ValidationError

from ffsm_controllers import GROUP as LAWS
from ffsm_controllers.estimators import GROUP as ESTIMATORS
from ffsm_mj.assembly.run import versions
from ffsm_mj.config import first_fault
from ffsm_mj.contact_models.impact.law import GROUP as IMPACT_LAWS
from ffsm_mj.contact_models.registry import GROUP as CONTACT_MODELS
from ffsm_mj.errors import InputError, LogWriteError, one_line
from ffsm_mj.experiments.design import Design
from ffsm_mj.experiments.metrics import COUNT, FileMetric, ScriptClasses
from ffsm_mj.experiments.metrics import GROUP as PLUGIN_METRICS
from ffsm_mj.experiments.planning import Plan
from ffsm_mj.invocation import option
from ffsm_mj.log.run_folder import SUMMARY
from ffsm_mj.records.events import Outcome
from ffsm_mj.report.output_place import refuse_link
from ffsm_mj.similar_names import similar_file
from ffsm_mj.yaml import YamlFault, plain_value, write_yaml

LOCK = "driver.lock"


def write_whole(file: Path, data: bytes) -> None:
    """Write a file, completely or not at all; its folder is created if it does not exist.

    Raises:
        LogWriteError: It cannot be written (full disk).
    """
    unfinished = file.with_name(f".{file.name}-{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        unfinished.unlink(missing_ok=True)
        with unfinished.open("xb") as stream:
            stream.write(data)
        os.replace(unfinished, file)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise LogWriteError(file, error) from error


CAMPAIGN, DESIGN, TABLE, SCENARIO = "campaign.yaml", "design.json", "rows.sqlite", "scenario/scenario.yaml"
RECORD, METRICS, VARIANTS, RERUNS = "record.json", "metrics.py", "variants", "reruns"
_ALL = (LOCK, CAMPAIGN, DESIGN, TABLE, "scenario", RECORD, METRICS, VARIANTS, RERUNS)
_UNFINISHED = tuple(f".{name}-" for name in _ALL)
"""How names of files begin that a process that was killed has not completed."""
_BEFORE_DESIGN = (LOCK, CAMPAIGN, TABLE, "scenario", RECORD, METRICS)


@dataclass(frozen=True)
class Record:
    """What the folder of a campaign holds besides the campaign file.

    Attributes:
        not_applicable: Why the control laws of a variant cannot be created for its scenario, by name of the variant.
        metrics: Names of metrics that are functions of the caller.
        metrics_file: Name of the Python file that defines them, whose copy is in the folder; empty for those of a script.
        format: Version of the file.
    """

    not_applicable: Mapping[str, str] = field(default_factory=dict)
    metrics: tuple[str, ...] = ()
    metrics_file: str = ""
    format: Literal[1] = 1


class CampaignFolder:
    """File names and files of a campaign.

    Attributes:
        path: The folder.
    """

    def __init__(self, path: Path) -> None:
        """Store the path; nothing is created."""
        self.path = path

    @property
    def is_initialized(self) -> bool:
        """Whether the folder holds a campaign: the design, or with variants the record, is written before the first run."""
        return (self.path / (RECORD if self.has_variants else DESIGN)).is_file()

    @property
    def has_variants(self) -> bool:
        """Whether the folder holds the variants of a campaign."""
        return (self.path / VARIANTS).is_dir()

    def variant(self, name: str) -> CampaignFolder:
        """Folder of a variant, which is a campaign."""
        return CampaignFolder(self.path / VARIANTS / name)

    @property
    def table(self) -> Path:
        """Path of the SQLite file with the rows."""
        return self.path / TABLE

    @property
    def scenario(self) -> Path:
        """Path of the resolved base scenario, beside its models."""
        return self.path / SCENARIO

    def rerun(self, index: int) -> Path:
        """Run folder of a repeated run."""
        return self.path / RERUNS / f"{index:06d}"

    def has_rerun(self, index: int) -> bool:
        """Whether a run was repeated without interruption."""
        try:
            summary = json.loads((self.rerun(index) / SUMMARY).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return False
        return bool(summary.get("outcome") != Outcome.INTERRUPTED)

    def refuse_links(self) -> None:
        """Refuse symbolic links inside the folder: nothing is written through them. The folder itself may be a link.

        Raises:
            InputError: A file or folder of the campaign is a symbolic link.
        """
        variants = self.path / VARIANTS
        for path in (*(self.path / name for name in _ALL), *(variants.iterdir() if self.has_variants else ())):
            refuse_link(path)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Context with exclusive access for one driver; the operating system releases the lock when the process ends.

        Raises:
            InputError: Another process runs this campaign, or the folder cannot be created.
        """
        self.refuse_links()
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = FileLock(self.path / LOCK)
            lock.acquire(timeout=0)
        except Timeout as error:
            raise InputError(f"{self.path}: another process is running this campaign") from error
        except OSError as error:
            raise InputError(f"{self.path}: cannot be used as a campaign folder ({error.strerror})") from error
        try:
            yield
        finally:
            lock.release()

    def write(
        self,
        config: Mapping[str, Any],
        scenario_yaml: str,
        files: Mapping[str, bytes],
        design: Design,
        record: Record | None = None,
        metrics: str = "",
    ) -> None:
        """Write all files of a new campaign; the design comes last and marks the folder as complete.

        Args:
            config: The campaign file.
            scenario_yaml: Resolved base scenario.
            files: Model files by name.
            design: Samples of all runs.
            record: Metrics of the caller, if there are any.
            metrics: Content of their file.

        Raises:
            InputError: The folder holds other files.
            LogWriteError: A file cannot be written (full disk).
        """
        self.refuse_other_files(_BEFORE_DESIGN)
        if (self.path / CAMPAIGN).is_file() and (self.path / CAMPAIGN).read_bytes() != _file_content(config):
            raise InputError(f"{self.path}: holds {CAMPAIGN}, which would be overwritten; choose another {option('out')}")
        models = {f"scenario/{name}": data for name, data in files.items()}
        for name, data in {SCENARIO: scenario_yaml.encode(), **models}.items():
            write_whole(self.path / name, data)
        if record is not None and record.metrics:
            self.write_record(record, metrics)
        self.write_config(config)
        self.write_design(design)

    def refuse_other_files(self, ours: tuple[str, ...] = (LOCK, CAMPAIGN, RECORD, METRICS, VARIANTS)) -> None:
        """Refuse a folder that holds anything but a campaign.

        Raises:
            InputError: It holds another file.
        """
        names = sorted(entry.name for entry in self.path.iterdir())
        others = [name for name in names if name not in ours and not name.startswith(_UNFINISHED)]
        if others:
            raise InputError(f"{self.path}: holds {others[0]} but no campaign; choose another {option('out')}")

    def write_variants(self, config: Mapping[str, Any], record: Record, metrics: str) -> None:
        """Write the files of a campaign with variants; the record comes last and marks the folder as complete.

        Args:
            config: The campaign file.
            record: What the folder holds besides it.
            metrics: Content of the metrics file.

        Raises:
            LogWriteError: A file cannot be written (full disk).
        """
        write_whole(self.path / CAMPAIGN, write_yaml(config).encode())
        self.write_record(record, metrics)

    def write_record(self, record: Record, metrics: str) -> None:
        """Write the record, and a copy of the metrics file, which is never executed; empty: there is none."""
        if metrics:
            write_whole(self.path / METRICS, metrics.encode())
        write_whole(self.path / RECORD, json.dumps(asdict(record), indent=1).encode())

    def record(self) -> Record:
        """Read what the folder holds besides the campaign file.

        Raises:
            InputError: It cannot be read.
        """
        file = self.path / RECORD
        if not file.is_file():
            if self.has_variants:
                raise InputError(f"{self.path}: holds no complete campaign (no {RECORD}); run it again with its file")
            return Record()
        try:
            return TypeAdapter(Record).validate_json(file.read_text(encoding="utf-8"), strict=True)
        except (OSError, ValueError) as error:
            why = first_fault(error) if isinstance(error, ValidationError) else one_line(str(error))
            raise InputError(f"{file}: is not the record of a campaign ({why})") from error

    def write_config(self, config: Mapping[str, Any]) -> None:
        """Write the campaign file; its scenario is the one in the folder."""
        write_whole(self.path / CAMPAIGN, _file_content(config))

    def write_design(self, design: Design) -> None:
        """Write the design, completely or not at all."""
        write_whole(self.path / DESIGN, design.to_json().encode())

    def design(self) -> Design:
        """Read the design.

        Raises:
            InputError: There is none, or it cannot be read.
        """
        file = self.path / DESIGN
        try:
            return Design.from_json(file.read_text(encoding="utf-8"))
        except OSError as error:
            there = self.path.is_dir()
            what = f"holds no campaign (no {DESIGN})" if there else f"no such campaign folder{similar_file(self.path)}"
            raise InputError(f"{self.path}: {what}") from error
        except InputError as error:
            raise InputError(f"{file}: {error}") from error


def _file_content(config: Mapping[str, Any]) -> bytes:
    """Content of the campaign file; its scenario is the one in the folder."""
    return write_yaml({**config, "scenario": SCENARIO, "overrides": {}}).encode()


_MOST_CHANGES = 3


def row_versions() -> dict[str, str]:
    """Versions of all packages that affect rows: the libraries and plug-in packages."""
    all_versions = dict(versions())
    for group in (LAWS, ESTIMATORS, PLUGIN_METRICS, IMPACT_LAWS, CONTACT_MODELS):
        for point in entry_points(group=group):
            if point.dist is not None:
                all_versions[point.dist.name] = point.dist.version
    return all_versions


def campaign_settings(plan: Plan, classes: ScriptClasses) -> str:
    """Settings of a campaign as JSON text with sorted keys.

    Args:
        plan: Campaign file and base scenario.
        classes: Control laws, estimators and metrics of a script.
    """
    config = plan.config
    sampling = {
        "samples": config.samples.model_dump(mode="json", exclude={"n"}),
        "dispersions": config.model_dump(mode="json", exclude_none=True)["dispersions"],
    }
    # Campaigns with the default have the same settings as before the key existed.
    counted = {} if config.truncated == COUNT else {"truncated": config.truncated}
    content = {
        "scenario": plan.base.scenario_yaml,
        "models": {name: hashlib.sha256(data).hexdigest() for name, data in sorted(plan.base.logged_files.items())},
        "sampling": sampling | counted,
        "metrics": list(config.all_metrics),
        "controllers": {kind: source_of(law) for kind, law in classes.controllers.items()},
        "versions": row_versions(),
    }
    if classes.estimators:  # campaigns without have the same settings as before there were any
        content["estimators"] = {kind: source_of(estimator) for kind, estimator in classes.estimators.items()}
    if classes.metrics:  # likewise; lines, so that differences name the first that changed
        content["metric functions"] = {name: source_of(metric).splitlines() for name, metric in classes.metrics.items()}
    return json.dumps(content, sort_keys=True, indent=1)


def source_of(law: Any) -> str:
    """Source code of a class or function; its full name if there is no source."""
    if isinstance(law, FileMetric):
        return law.text
    try:
        return inspect.getsource(law)
    except (OSError, TypeError):
        return f"{law.__module__}.{getattr(law, '__qualname__', type(law).__qualname__)}"


def settings_hash(settings: str) -> str:
    """SHA-256 of the settings."""
    return hashlib.sha256(settings.encode()).hexdigest()


def settings_changes(stored: str, now: str) -> str:
    """Differences between two settings as text; the stored settings may be damaged."""
    try:
        a, b = (_leaves(_with_parsed_scenario(json.loads(text))) for text in (stored, now))
    except (ValueError, TypeError, KeyError, RecursionError, YamlFault):
        return "the stored settings cannot be read"
    changes = [
        f"{key} {_short(a.get(key))} there, {_short(b.get(key))} here"
        for key in sorted({*a, *b})
        if a.get(key) != b.get(key)
    ]
    more = f"; and {len(changes) - _MOST_CHANGES} more" if len(changes) > _MOST_CHANGES else ""
    return "; ".join(changes[:_MOST_CHANGES]) + more


def _with_parsed_scenario(settings: dict[str, Any]) -> dict[str, Any]:
    return settings | {"scenario": plain_value(settings["scenario"])}


def _leaves(value: Any, key: str = "") -> dict[str, Any]:
    """Scalars of nested data by dotted key."""
    if isinstance(value, Mapping) and value:
        pairs = value.items()
    elif isinstance(value, list) and value:
        pairs = dict(enumerate(value)).items()
    else:
        return {key: value}
    return {name: leaf for part, item in pairs for name, leaf in _leaves(item, f"{key}.{part}".lstrip(".")).items()}


def _short(value: Any) -> str:
    text = repr(value) if value is not None else "nothing"
    return text if len(text) <= 60 else f"{text[:60]}..."
