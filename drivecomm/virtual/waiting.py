"""Waiting for sockets and terminals, exact to the microsecond if the system supports it."""

from __future__ import annotations

import select
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import selectors

_MILLISECOND = 0.001
# Limit of the descriptors that `select.select` can watch.
_MOST_DESCRIPTORS = 1024


def ready_within(selector: selectors.BaseSelector, seconds: float) -> list[selectors.SelectorKey]:
    """Return the keys that are ready to be read, as soon as there is one, or after at most this many seconds."""
    if seconds > 0 and not _has_come(selector, seconds):
        return []
    return [key for key, _ in selector.select(0)]


def _has_come(selector: selectors.BaseSelector, seconds: float) -> bool:
    """Wait; return False only if nothing is ready."""
    descriptor = _descriptor(selector)
    if descriptor is None:
        return bool(selector.select(seconds))
    if descriptor < _MOST_DESCRIPTORS:
        # A selector with millisecond resolution is itself readable as soon as one of its descriptors is.
        return bool(select.select([descriptor], [], [], seconds)[0])
    whole = seconds // _MILLISECOND * _MILLISECOND
    if whole:
        return bool(selector.select(whole))
    time.sleep(seconds)
    return True


def _descriptor(selector: selectors.BaseSelector) -> int | None:
    """Return the descriptor of a selector; None for a plain one, whose own wait is exact enough."""
    fileno = getattr(selector, "fileno", None)
    return None if fileno is None else int(fileno())
