"""Why a verdict is as it is, in one sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.traffic.cohabitation.outlines import leaves_of
from drivecomm.traffic.cohabitation.trial import TELEGRAMS

if TYPE_CHECKING:
    from drivecomm.protocol import LineSettings
    from drivecomm.traffic.cohabitation.drives import Partner
    from drivecomm.traffic.cohabitation.outlines import Outline
    from drivecomm.traffic.cohabitation.traffic import Sightings
    from drivecomm.traffic.cohabitation.verdicts import Proof


def safe(sightings: Sightings, *, whole: bool) -> str:
    """Say what keeps the telegrams apart."""
    if whole:
        return (
            "both speak the same protocol: each telegram is read from its beginning, and the address tells them apart"
        )
    farthest = sightings.farthest()
    if farthest is None:
        starts = {_meaning(each, 0) for each in sightings.wanted}
        return f"no character of this traffic begins a telegram ({_listed(starts)})"
    number, place = farthest
    wanted = sightings.wanted[number]
    stop = _meaning(wanted, place + 1)
    return f"of {wanted.title} at most {place + 1} characters in a row can be met, then never {stop}"


def unheard(speaker: Partner, settings: LineSettings) -> str:
    """Say that it was only tried."""
    return (
        f"{speaker.settings} heard at {settings} gives other characters, which the forms say nothing about; "
        f"none of {TELEGRAMS} arbitrary telegrams was taken"
    )


def never_read(sightings: Sightings) -> str:
    """Say that it hangs on contents that were never read."""
    return (
        "the forms leave room for one, and none could be made: codecs were seen to use other contents only "
        f"({safe(sightings, whole=False)})"
    )


def open_question(sightings: Sightings) -> str:
    """Say where a telegram may begin that nobody could make."""
    (number, place), (wanted, _) = sightings.starts[0]
    heard = sightings.traffic.outlines[number]
    title = sightings.wanted[wanted].title
    return f"the characters of {heard.title} leave room for {title} from character {place + 1}, and none could be made"


def taken(proof: Proof, speaker: str, listener: str) -> str:
    """Say what is taken for what."""
    first = proof.telegrams[0]
    end = "" if len(proof.telegrams) == 1 else f", together with what follows ({proof.telegrams[-1].title})"
    whose = "to" if first.direction == "request" else "of"
    return f"{first.title} {whose} {speaker} holds {proof.title} for {listener} from character {proof.offset + 1}{end}"


def _meaning(outline: Outline, place: int) -> str:
    """Return what stands at a place: the meaning of its leaf, or else its name."""
    if place >= len(outline.places):
        return "its end"
    name, leaf = leaves_of(outline.form)[outline.places[place].leaf]
    return getattr(leaf, "meaning", "") or name or "the next character"


def _listed(words: set[str]) -> str:
    return ", ".join(sorted(words))
