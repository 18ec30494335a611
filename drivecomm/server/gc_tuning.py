"""Short pauses for Python's garbage collection, which stops all threads of a process, and so all its lines.

An OPC UA door for 500 drives holds some hundred thousand objects. A full collection takes a third of a second, and
Python starts one every few seconds although none of these objects is garbage. After a long collection, the objects
found in use are frozen: later collections skip them.
"""

from __future__ import annotations

import gc
import time
from typing import Literal

_LONG_S = 0.02
_NEW_OBJECTS = 10_000
"""Number of new objects that starts a young collection; Python's own 700 are reached with every few telegrams."""


class _Search:
    began = 0.0


def keep_searches_short() -> None:
    """Keep garbage collections short in this process.

    Cyclic garbage among frozen objects is freed only after `search_everything`.
    """
    gc.set_threshold(_NEW_OBJECTS, *gc.get_threshold()[1:])
    gc.callbacks.append(_watch)


def search_everything() -> None:
    """Make the next full collection examine all objects again; call it when many frozen ones are no longer in use.

    Has no effect unless `keep_searches_short` was called.
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
