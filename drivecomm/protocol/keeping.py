"""What polling asks for again and again is made once: what an address means, and the request for it."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec("P")
R = TypeVar("R")

_MOST = 512
"""More than a poll plan has."""


def kept(make: Callable[P, R]) -> Callable[P, R]:
    """Return what makes the same thing for the same arguments only once, of a model and options that do not change."""
    return lru_cache(_MOST, typed=True)(make)  # type: ignore[return-value]
