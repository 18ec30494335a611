"""Reply times and pauses of a drive, compared with the line facts of its protocol and model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.commissioning import tune
from drivecomm.errors import NotSupported
from drivecomm.proving.findings import ProofFinding

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.bus import Drive

EXCHANGES = 100
"""Number of exchanges that must succeed with the shortest pause; they take some seconds."""

_ABOUT = "the pause after a reply, and the time for a reply"


def timing_findings(drive: Drive, progress: Callable[[str, int, int], None]) -> Iterator[ProofFinding]:
    """Yield the findings of a `tune` measurement; it sends only the protocol's probe, and changes no setting.

    Raises ReplyError if the drive stops answering, and LinkError if the port fails.
    """
    timing = drive.facts.untuned.timing
    usual_s = drive.facts.untuned.turnaround_s
    model = {"turnaround_ms": _ms(usual_s), "reply_timeout_ms": _ms(timing.reply_timeout_s)}
    try:
        found = tune(drive, EXCHANGES, progress=progress)
    except NotSupported as error:
        yield ProofFinding(kind="timing", verdict="not asked", about=_ABOUT, why=str(error))
        return
    delays = found.reply_delays
    said = {"reply_begins_after_ms": [_ms(delays.shortest_s), _ms(delays.longest_s)]} if delays.count else {}
    if found.error:
        why = f"it fails with its usual pause, and with longer ones: {found.error}"
        yield ProofFinding(kind="timing", verdict="contradicts", about=_ABOUT, model=model, drive=said, why=why)
        return
    if found.before.error:
        needs = {"turnaround_ms": _ms(found.turnaround_s), "reply_timeout_ms": _ms(found.reply_timeout_s)}
        why = f"it fails with its usual times ({found.before.error}), and works with longer ones"
        yield ProofFinding(kind="timing", verdict="contradicts", about=_ABOUT, model=model, drive=said | needs, why=why)
        return
    yield ProofFinding(kind="timing", verdict="agrees", about=_ABOUT, model=model, drive=said)
    if found.held_s < usual_s:
        yield ProofFinding(
            kind="timing",
            verdict="new",
            about="the shortest pause after a reply",
            model=model,
            drive={"pause_ms": _ms(found.held_s), "exchanges": found.after.exchanges},
            why=f"{_ms(found.held_s):g} ms was enough, instead of {_ms(usual_s):g} ms",
        )


def _ms(seconds: float) -> float:
    return round(seconds * 1000, 3)
