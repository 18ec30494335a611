"""Sentences that give the reason for a verdict and the advice for the line."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from drivecomm.errors import AddressError
from drivecomm.traffic.cohabitation.search import TELEGRAMS
from drivecomm.traffic.cohabitation.verdicts import Safety

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from drivecomm.protocol import LineSettings
    from drivecomm.traffic.cohabitation.drives import LineDrive
    from drivecomm.traffic.cohabitation.outlines import TelegramOutline
    from drivecomm.traffic.cohabitation.traffic_graph import Sightings
    from drivecomm.traffic.cohabitation.verdicts import MistakeProof, PairVerdict

ALIKE = "same protocol and settings: each telegram is read from its beginning, and the address tells them apart"

_TRIED = 12
"""Number of other addresses tried for a drive, spread over all addresses of its protocol."""


def safe_reason(sightings: Sightings, *, whole: bool) -> str:
    """Return the reason why no telegram can be mistaken for one of the listener."""
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
    return f"no traffic matches {wanted.title} beyond character {place + 1}: {stop} never follows"


def unheard_reason(speaker: LineDrive, settings: LineSettings) -> str:
    """Return the reason for a verdict that rests on trials only: nothing excludes a mistake, but no trial met one."""
    return (
        f"{speaker.settings} heard at {settings} gives other characters, which the forms say nothing about; "
        f"none of {TELEGRAMS} arbitrary telegrams was accepted"
    )


def never_read_reason(sightings: Sightings) -> str:
    """Return the reason for a verdict where a mistake needs contents that the codec never accepted."""
    return f"the forms leave room for one, but codecs use other contents only ({safe_reason(sightings, whole=False)})"


def open_reason(sightings: Sightings) -> str:
    """Return the reason for an open verdict: where a telegram may begin, although no example of one was found."""
    (number, place), (wanted, _) = sightings.starts[0]
    heard = sightings.traffic.outlines[number]
    title = sightings.wanted[wanted].title
    return (
        f"the characters of {heard.title} leave room for {title} from character {place + 1}: "
        "no mix-up found, but it cannot be ruled out"
    )


def taken_reason(proof: MistakeProof, speaker: str, listener: str) -> str:
    """Return a sentence that names the mistaken telegram, and the telegram that the listener finds in it."""
    first = proof.telegrams[0]
    end = "" if len(proof.telegrams) == 1 else f", together with what follows ({proof.telegrams[-1].title})"
    whose = "to" if first.direction == "request" else "of"
    return f"{first.title} {whose} {speaker} holds {proof.title} for {listener} from character {proof.offset + 1}{end}"


def _meaning(outline: TelegramOutline, place: int) -> str:
    """Return the meaning of the leaf at a place, or else its name."""
    if place >= len(outline.places):
        return "its end"
    name, leaf = outline.form.leaves[outline.places[place].leaf]
    return leaf.meaning or name or "the next character"


def _listed(words: set[str]) -> str:
    return ", ".join(sorted(words))


def advice(
    partners: Sequence[LineDrive],
    verdicts: Sequence[tuple[LineDrive, LineDrive, PairVerdict]],
    safe: Callable[[LineDrive, LineDrive], bool],
) -> Iterator[str]:
    """Yield sentences of advice for the line.

    safe: whether a speaker's traffic excludes a telegram for a listener.
    """
    bad = [each for each in verdicts if not each[2].safe]
    if not bad:
        tried = any(each[2].outcome is Safety.UNHEARD for each in verdicts)
        yield (
            "safe as far as it was tried: drives with different line settings hear each other as noise"
            if tried
            else "safe: these drives can share the line with these addresses and settings"
        )
        return
    for speaker, listener, _ in bad:
        known = listener.dialect.plugin.ambiguous_with.get(speaker.dialect.plugin.name)
        if known and speaker.address == listener.address:
            yield f"{listener.name} beside {speaker.name}: {known}"
    told = set()
    for speaker, listener, _ in bad:
        if listener.name in told:
            continue
        told.add(listener.name)
        speakers = [each for each in partners if each is not listener]
        address = _better_address(listener, speakers, safe)
        if address is not None:
            yield f"give {listener.name} another address, such as {address}; no telegram of the others fits that one"
        else:
            yield (
                f"no other address helps {listener.name} beside {speaker.name}: put them on separate lines, give them "
                "different baud rates, or see from the proof how rarely it happens"
            )


def _better_address(
    listener: LineDrive, speakers: Sequence[LineDrive], safe: Callable[[LineDrive, LineDrive], bool]
) -> int | None:
    plugin = listener.dialect.plugin
    taken = {each.address for each in speakers if each.dialect.plugin is plugin} | {listener.address}
    free = [address for address in plugin.addresses if address not in taken]
    for address in free[:: max(1, len(free) // _TRIED)]:
        with suppress(AddressError):  # raised if the options rule this address out
            moved = listener.at(address)
            if all(safe(speaker, moved) for speaker in speakers):
                return address
    return None
