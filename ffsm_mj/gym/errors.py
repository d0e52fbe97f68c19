"""Errors of environments."""

from __future__ import annotations

from ffsm_mj.errors import FfsmError


class EnvError(FfsmError):
    """An environment was used in a way that its state does not allow, or a part of it, such as a reward, failed."""
