"""What one question to a drive shows about one fact of its model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping

Verdict: TypeAlias = Literal["agrees", "contradicts", "new", "not asked"]
"""agrees: the drive said what the model says. contradicts: it said something else. new: it told what the model does not
know. not asked: nothing is known of it, for a reason."""

Kind: TypeAlias = Literal["identity", "parameter", "name plate", "refusal", "link loss", "timing", "motion"]

Shown: TypeAlias = Literal["exists", "described", "option", "scale", "text", "setting"]
"""What of a fact an answer shows. exists: the drive told a value. described: the drive itself told type, scale and
limits. option: it holds one of the listed options. scale: a value ten times as large or as small would not be
plausible. text: it told characters. setting: both parameters of the link loss hold what the model lists."""

DECISIVE: frozenset[Shown] = frozenset({"described", "option", "scale", "text", "setting"})
"""With one of these a fact is raised to the mark `drive`; that an address answers is not enough."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One line of a proof.

    about: the fact, in words. addresses: the parameters that it is about. model: what the model says, by key; drive:
    what the drive said. shows: what of the fact that shows. why: the reason of a verdict other than `agrees`.
    """

    kind: Kind
    verdict: Verdict
    about: str
    addresses: tuple[str, ...] = ()
    model: Mapping[str, Any] = field(default_factory=dict)
    drive: Mapping[str, Any] = field(default_factory=dict)
    shows: tuple[Shown, ...] = ()
    why: str = ""

    @property
    def is_decisive(self) -> bool:
        """Whether it agrees, and shows so much of its fact that a wrong fact would have been noticed."""
        return self.verdict == "agrees" and not DECISIVE.isdisjoint(self.shows)
