"""Findings: what the answer to one request proves about one fact of a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping

Verdict: TypeAlias = Literal["agrees", "contradicts", "new", "not asked"]
"""Verdict of a finding.

agrees: the drive's answer matches the model. contradicts: it does not. new: the answer is something that the model does
not contain. not asked: nothing was read; the reason is given.
"""

Kind: TypeAlias = Literal["identity", "parameter", "name plate", "refusal", "link loss", "timing", "motion"]

Shown: TypeAlias = Literal["exists", "described", "option", "scale", "text", "setting"]
"""Aspect of a fact that an answer proves.

exists: the drive returned a value. described: the drive itself described type, scale and limits. option: the value is
one of the listed options. scale: a value ten times as large or as small would not be plausible. text: the drive
returned characters. setting: both parameters of the link loss have values that the model lists.
"""

DECISIVE: frozenset[Shown] = frozenset({"described", "option", "scale", "text", "setting"})
"""Aspects that raise a fact to the mark `drive`; an answering address alone is not enough."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofFinding:
    """One entry of a proof.

    about: the fact, in words. addresses: the parameters of the fact. model: the model's facts by key. drive: the
    drive's answers. shows: the aspects of the fact that the answers prove. why: the reason for a verdict other than
    `agrees`.
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
        """Whether the finding agrees, and would have revealed a wrong fact."""
        return self.verdict == "agrees" and not DECISIVE.isdisjoint(self.shows)
