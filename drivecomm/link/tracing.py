"""Several trace functions as one, for `open_bus(trace=...)`."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link.link import TraceEvent


def tell_all(*traces: Callable[[TraceEvent], None] | None) -> Callable[[TraceEvent], None] | None:
    """Return a trace function that passes everything on to these, in order; None where there is nobody to tell."""
    listening = [trace for trace in traces if trace is not None]
    if len(listening) < 2:
        return listening[0] if listening else None

    def tell(event: TraceEvent) -> None:
        for trace in listening:
            trace(event)

    return tell
