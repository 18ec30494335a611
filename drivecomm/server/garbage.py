"""Keeps Python's search for garbage short, which stops all threads of a process, and so all its lines.

An OPC UA door for 500 drives holds some hundred thousand objects. To go through them takes a third of a second, and
Python does it every few seconds, although none of them has become garbage. A search that takes long leaves out from
then on what it has found in use.
"""

from __future__ import annotations

import gc
import time
from typing import Literal

_LONG_S = 0.02
_NEW_OBJECTS = 10_000
"""So many are made before the newest are searched; Python's own 700 come with each few telegrams."""


class _Search:
    began = 0.0


def keep_searches_short() -> None:
    """Begin with it, for the whole of this process; it costs what becomes garbage late, see `search_everything`."""
    gc.set_threshold(_NEW_OBJECTS, *gc.get_threshold()[1:])
    gc.callbacks.append(_watch)


def search_everything() -> None:
    """Let the next search go through everything again: when much of what was in use is not any more.

    It changes nothing in a process whose searches are not kept short.
    """
    if _watch in gc.callbacks:
        gc.unfreeze()


def _watch(phase: Literal["start", "stop"], search: dict[str, int]) -> None:
    if search["generation"] < 2:
        return
    if phase == "start":
        _Search.began = time.perf_counter()
    elif time.perf_counter() - _Search.began > _LONG_S:
        gc.freeze()
