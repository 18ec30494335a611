"""What changes between two looks at a drive, in words. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from drivecomm.plant.watching.board import DriveView
    from drivecomm.protocol import DriveStatus

Kind: TypeAlias = Literal["fault", "silent", "warning", "change", "command"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Happening:
    """Something that a person wants to know later. time_s: since watching began."""

    time_s: float
    drive: str
    kind: Kind
    text: str


def changes(before: DriveView, after: DriveView, time_s: float) -> list[Happening]:
    """Return what happened to a drive between two looks at it."""
    found: list[tuple[Kind, str]] = []
    if after.condition == "silent" != before.condition:
        found.append(("silent", after.error or "does not answer"))
    if after.condition == "answers" and before.condition == "silent":
        found.append(("change", "answers again"))
    if after.condition == "answers":
        found += _by_status(before, after)
    return [Happening(time_s=time_s, drive=after.name, kind=kind, text=text) for kind, text in found]


def _by_status(before: DriveView, after: DriveView) -> list[tuple[Kind, str]]:
    if after.status is None:
        return []
    if after.fault:
        return [("fault", f"fault: {after.fault}")] if after.fault != before.fault else []
    found: list[tuple[Kind, str]] = []
    if before.fault:
        found.append(("change", "the fault is gone"))
    if after.status.warning and not (before.status and before.status.warning):
        found.append(("warning", "warning"))
    if before.status is not None and state_words(after.status) != state_words(before.status):
        found.append(("change", state_words(after.status)))
    return found


def state_words(status: DriveStatus) -> str:
    """Return the state of a drive in words: running, running backwards, ready, not ready, stopping, fault."""
    words = status.state.value.replace("_", " ")
    return f"{words} backwards" if status.running and status.reverse else words
