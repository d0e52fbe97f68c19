"""One model of a scenario as a specification, as every scene is made of it: stripped, changed, given sites."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ffsm_mj.model.alone import warnings_alone
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.overrides import ModelOverrides, override
from ffsm_mj.model.sites import add_sites
from ffsm_mj.model.source import load_spec
from ffsm_mj.model.strip import strip


@dataclass(frozen=True)
class Part:
    """A model to be attached.

    Attributes:
        spec: Its specification; all its elements have names.
        notes: What was taken out, and what the file says in vain, for people.
        overridden: What was changed, to be read back out of the compiled scene; None where nothing was.
        warnings: MuJoCo's warnings about the model compiled alone.
    """

    spec: Any
    notes: list[str]
    overridden: ModelOverrides | None
    warnings: tuple[str, ...]


def part(name: str, files: ModelFiles, vfs: Any) -> Part:
    """Make one model ready, in this order: what is stripped goes, properties are changed, sites are added.

    Args:
        name: What it is called in the scene.
        files: Its files and what is to be done to them.
        vfs: MuJoCo's virtual files; the model's are added. They are needed until the scene is compiled.

    Raises:
        InputError: MuJoCo does not take the model.
        ScenarioFaults: A site cannot be put where it is wanted, or a property is none that the model can have.
    """
    spec = load_spec(files, vfs)
    notes = [f"taken out of {name}: {what}" for what in strip(spec, files.strip)]
    if spec.compiler.settotalmass > 0.0:
        notes.append(f"{files.place}: <compiler settotalmass> has no effect on a model in a scene; say masses under 'model'")
    overridden = override(spec, name, files, vfs) if files.overrides else None
    warnings = overridden.warnings if overridden is not None else warnings_alone(files, vfs)
    add_sites(spec, files.sites)
    return Part(spec, notes, overridden, warnings)
