"""Results of a cohabitation check."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.protocol import Direction


class Safety(Enum):
    """Whether a listener can mistake the telegrams of a speaker for its own.

    SAFE: excluded, because no sequence of the speaker's telegrams can contain one for the listener. UNHEARD: not met in
    any trial, although the places cannot exclude it: the settings differ too much, or it needs contents that no codec
    was seen to use. OPEN: nothing excludes it, and no telegrams prove it. TAKEN: proven by telegrams that the listener
    accepts as its own.
    """

    SAFE = "safe"
    UNHEARD = "unheard"
    OPEN = "open"
    TAKEN = "taken"


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofTelegram:
    """A telegram of the proof. title: of its form. data: bytes as sent. heard: bytes as the listener hears them."""

    title: str
    direction: Direction
    data: bytes
    heard: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class MistakeProof:
    """Telegrams of one drive in which another drive finds a telegram of its own.

    telegrams: telegrams on the line, in order. offset: position, in the bytes as heard, at which the other drive's
    telegram begins. taken: that telegram. title: title of its form. fields: its content. bits: number of bits that must
    be right by chance if the other contents are arbitrary: one in 2**bits such telegrams contains it; None if unknown.
    """

    telegrams: tuple[ProofTelegram, ...]
    offset: int
    taken: bytes
    title: str
    fields: Mapping[str, Any] = field(hash=False)
    bits: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PairVerdict:
    """The verdict on a pair of drives. speaker, listener: their names. reason: explanation in one sentence."""

    speaker: str
    listener: str
    outcome: Safety
    reason: str
    proof: MistakeProof | None = None

    @property
    def safe(self) -> bool:
        """Whether a mistake is excluded, or was not met in any trial."""
        return self.outcome in (Safety.SAFE, Safety.UNHEARD)
