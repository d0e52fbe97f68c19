"""Models compiled alone, before they are attached to a scene.

A reference to a missing element is an error then; attaching would drop such a motor or constraint silently. A campaign
compiles the same files thousands of times, so results are kept for the process.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import mujoco

from ffsm_mj.errors import InputError
from ffsm_mj.model.compilation import compile_spec
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.mujoco_warnings import collected_warnings
from ffsm_mj.model.source import REFUSALS, digest_of, load_spec, mujoco_line

_NOT_ALIGNED = mujoco.mjtAlignFree.mjALIGNFREE_FALSE


@dataclass(frozen=True)
class CompiledAlone:
    """A model compiled alone.

    Attributes:
        mj: The MuJoCo model, shared and only to be read.
        warnings: MuJoCo's warnings about it.
    """

    mj: Any
    warnings: tuple[str, ...]


def warnings_alone(files: ModelFiles, vfs: Any) -> tuple[str, ...]:
    """Compile a model as its files are; returns MuJoCo's warnings.

    Args:
        files: Files of the model.
        vfs: MuJoCo's virtual files; the model's are added if it is compiled.

    Raises:
        InputError: It does not compile.
    """
    return _warnings(_request(files, vfs))


def compiled_alone(files: ModelFiles, vfs: Any) -> CompiledAlone:
    """Compile the specification of :func:`spec_alone`.

    Args:
        files: Files of the model.
        vfs: MuJoCo's virtual files; the model's are added if it is compiled.

    Raises:
        InputError: It does not compile.
    """
    return _compiled(_request(files, vfs))


def spec_alone(files: ModelFiles, vfs: Any) -> Any:
    """A model with the bodies, geoms and masses that it has in a scene, each body in the frame of its file.

    Raises:
        InputError: MuJoCo cannot parse it.
    """
    spec = load_spec(files, vfs)
    spec.compiler.settotalmass = -1.0  # only the compiler of the scene could do these
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    for joint in spec.joints:
        joint.align = _NOT_ALIGNED
    return spec


@dataclass(frozen=True)
class _Request:
    """A model to be compiled, compared by the content of its files."""

    digest: str
    main: str
    floats: bool
    body: str
    files: ModelFiles = field(compare=False)
    vfs: Any = field(compare=False)


def _request(files: ModelFiles, vfs: Any) -> _Request:
    return _Request(digest_of(files), files.main, files.pose is None, files.body, files, vfs)


@lru_cache(maxsize=8)
def _warnings(asked: _Request) -> tuple[str, ...]:
    return _compile(load_spec, asked).warnings


@lru_cache(maxsize=8)
def _compiled(asked: _Request) -> CompiledAlone:
    return _compile(spec_alone, asked)


def _compile(load: Any, asked: _Request) -> CompiledAlone:
    warnings: list[str] = []
    with collected_warnings(warnings):
        spec = load(asked.files, asked.vfs)
        try:
            return CompiledAlone(compile_spec(spec, asked.vfs), tuple(warnings))
        except REFUSALS as error:
            raise InputError(mujoco_line(asked.files, error)) from error
