"""Cache for results that polling needs repeatedly: the meaning of an address, and the request for it."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec("P")
R = TypeVar("R")

_MOST = 512
"""Number of cached results; more than a poll plan needs."""


def kept(make: Callable[P, R]) -> Callable[P, R]:
    """Cache the results of a function; its arguments, such as a model and options, must not change."""
    return lru_cache(_MOST, typed=True)(make)  # type: ignore[return-value]
