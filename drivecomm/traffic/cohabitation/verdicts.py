"""What a cohabitation check finds out."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Direction


class Safety(Enum):
    """Whether a listener can mistake the telegrams of a speaker for its own.

    SAFE: excluded, because no sequence of the speaker's telegrams can contain one for the listener.
    UNHEARD: not met in all that was tried, where the places cannot exclude it: the settings differ too much, or it
    hangs on contents that no codec was seen to use. OPEN: nothing excludes it, and no telegrams prove it. TAKEN: there
    are telegrams that the listener takes for its own; they are the proof.
    """

    SAFE = "safe"
    UNHEARD = "unheard"
    OPEN = "open"
    TAKEN = "taken"


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofTelegram:
    """A telegram of the proof. title: the form's; direction: of the telegram; data: as sent; heard: as it is heard."""

    title: str
    direction: Direction
    data: bytes
    heard: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Proof:
    """Telegrams of one drive in which another one finds a telegram of its own.

    telegrams: what is on the line, one after the other. offset: where in them, as heard, the other's begins. taken: the
    other's telegram. title: of its form. fields: its content. bits: how many bits have to fall right by chance for it,
    when the rest of the contents is arbitrary: it is met once in 2 to the power of this many such telegrams.
    """

    telegrams: tuple[ProofTelegram, ...]
    offset: int
    taken: bytes
    title: str
    fields: Mapping[str, Any] = field(hash=False)
    bits: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PairVerdict:
    """The verdict on a pair. speaker, listener: names of the drives. reason: a sentence that says why."""

    speaker: str
    listener: str
    outcome: Safety
    reason: str
    proof: Proof | None = None

    @property
    def safe(self) -> bool:
        """Whether a mistake is excluded, or was not met in any trial."""
        return self.outcome in (Safety.SAFE, Safety.UNHEARD)
