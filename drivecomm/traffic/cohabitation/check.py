"""The cohabitation check: for each pair of drives on a line, what one can mistake in the traffic of the other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from random import Random
from typing import TYPE_CHECKING

from drivecomm.traffic.cohabitation import explanations
from drivecomm.traffic.cohabitation.drives import partners_of
from drivecomm.traffic.cohabitation.explanations import advice
from drivecomm.traffic.cohabitation.outlines import as_usual
from drivecomm.traffic.cohabitation.sampling import any_telegram
from drivecomm.traffic.cohabitation.search import find_proof, try_out
from drivecomm.traffic.cohabitation.traffic import Reader, Sightings, Traffic, character_map
from drivecomm.traffic.cohabitation.verdicts import PairVerdict, Proof, Safety
from drivecomm.virtual import heard

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import DriveConfig, LineSettings
    from drivecomm.traffic.cohabitation.drives import Partner
    from drivecomm.traffic.cohabitation.outlines import Outline

_SEED = 1
_READ_WHOLE = 200
"""Arbitrary telegrams of each form, to see whether a drive of the same protocol reads them from their beginning."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cohabitation:
    """What was found out about a line.

    drives: what each drive, listening, can take of another one's telegrams. master: what the master can take for a
    drive's reply when another drive answers late. advice: what follows for the line, in sentences.
    """

    drives: tuple[PairVerdict, ...]
    master: tuple[PairVerdict, ...]
    advice: tuple[str, ...]

    @property
    def safe(self) -> bool:
        """Whether no drive can mistake another one's telegrams, or no such case was found."""
        return all(each.safe for each in self.drives)


def check_line(drives: Sequence[DriveConfig]) -> Cohabitation:
    """Find out whether drives on one line can take each other's telegrams for their own.

    The same drives always give the same result. Raises UsageError for a drive that cannot be.
    """
    partners = partners_of(drives)
    pairs = [(speaker, listener) for speaker in partners for listener in partners if speaker is not listener]
    verdicts = [(speaker, listener, listen(speaker, listener)) for speaker, listener in pairs]
    return Cohabitation(
        drives=tuple(verdict for _, _, verdict in verdicts),
        master=tuple(wait_for(expected, late) for late, expected in pairs),
        advice=tuple(advice(partners, verdicts, _is_excluded)),
    )


def listen(speaker: Partner, listener: Partner) -> PairVerdict:
    """Find out which requests to another drive, and which of its replies, a drive can mistake for its own."""
    return (
        _examine(*_as_listener(speaker, listener)) if not _are_alike(speaker, listener) else _alike(speaker, listener)
    )


def _are_alike(one: Partner, other: Partner) -> bool:
    """Whether two drives differ in their addresses only, as on any line with drives of one protocol."""
    return one.dialect is other.dialect and one.settings == other.settings and one.address != other.address


def _alike(speaker: Partner, listener: Partner) -> PairVerdict:
    return PairVerdict(speaker=speaker.name, listener=listener.name, outcome=Safety.SAFE, reason=explanations.ALIKE)


def _as_listener(speaker: Partner, listener: Partner) -> tuple[Partner, Sequence[Outline], Ear]:
    related = speaker.dialect.plugin is listener.dialect.plugin
    ear = Ear(
        name=listener.name,
        settings=listener.settings,
        reader=Reader(codec=listener.ear, direction="request", means=listener.is_meant),
        wanted=listener.understood,
        of_anybody=listener.dialect.read_as("request") if related else (),
    )
    # What is for all drives of a protocol is for this one too.
    return speaker, [each for each in speaker.spoken if not (related and each.to_all)], ear


def wait_for(expected: Partner, late: Partner) -> PairVerdict:
    """Find out whether the master can mistake another drive's late reply for the one that it waits for."""
    if _are_alike(late, expected):
        return _alike(late, expected)
    ear = Ear(
        name=expected.name,
        settings=expected.settings,
        reader=Reader(codec=expected.dialect.codec, direction="reply", means=expected.is_from),
        wanted=expected.answers,
        of_anybody=expected.dialect.read_as("reply") if expected.dialect.plugin is late.dialect.plugin else (),
    )
    return _examine(late, [each for each in late.spoken if each.direction == "reply"], ear)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ear:
    """Who listens.

    settings: its line settings. wanted: what it takes for itself. of_anybody: the same for all addresses, where it
    speaks the protocol of what it hears.
    """

    name: str
    settings: LineSettings
    reader: Reader
    wanted: Sequence[Outline]
    of_anybody: Sequence[Outline]


def _examine(speaker: Partner, spoken: Sequence[Outline], ear: Ear) -> PairVerdict:
    chance = Random(_SEED)  # noqa: S311 - repeatable on purpose
    hears = character_map(speaker.settings, ear.settings)
    proof: Proof | None
    if hears is None:
        proof = try_out(spoken, speaker, ear.settings, ear.reader, chance)
        outcome, reason = (Safety.TAKEN, "") if proof else (Safety.UNHEARD, explanations.unheard(speaker, ear.settings))
    else:
        traffic = Traffic(spoken, hears)
        sightings, whole = _sightings(traffic, speaker, ear, chance)
        # What is looked into anyway comes first; the rest is only once the listener has lost its place.
        places = [Sightings(traffic, ear.wanted, _looked_into(traffic, speaker, ear, chance)), sightings]
        tried = [each for each in places if sightings.starts and each.starts]
        proofs = (find_proof(each, speaker, ear.settings, ear.reader, chance) for each in tried)
        proof = next((each for each in proofs if each is not None), None)
        if proof is None and sightings.starts:
            usual = replace(ear, wanted=list(map(as_usual, ear.wanted)), of_anybody=list(map(as_usual, ear.of_anybody)))
            left, _ = _sightings(Traffic(list(map(as_usual, spoken)), hears), speaker, usual, chance)
            if left.starts:
                outcome, reason = Safety.OPEN, explanations.open_question(left)
            else:
                outcome, reason = Safety.UNHEARD, explanations.never_read(left)
        else:
            outcome, reason = Safety.SAFE, explanations.safe(sightings, whole=whole)
    if proof is not None:
        outcome, reason = Safety.TAKEN, explanations.taken(proof, speaker.name, ear.name)
    return PairVerdict(speaker=speaker.name, listener=ear.name, outcome=outcome, reason=reason, proof=proof)


def _is_excluded(speaker: Partner, listener: Partner) -> bool:
    """Whether the telegrams of a speaker cannot contain one for the listener, whatever they carry."""
    _, spoken, ear = _as_listener(speaker, listener)
    hears = character_map(speaker.settings, ear.settings)
    if hears is None:
        return False
    chance = Random(_SEED)  # noqa: S311 - repeatable on purpose
    return not _sightings(Traffic(spoken, hears), speaker, ear, chance)[0].starts


def _sightings(traffic: Traffic, speaker: Partner, ear: Ear, chance: Random) -> tuple[Sightings, bool]:
    """Return where a telegram may be found, and whether that counts on telegrams that are read from their beginning.

    A drive that hears telegrams of its own protocol does not look into them. It does once it has lost its place, which
    it can where a telegram, whoever it is for, begins in one of the others and ends in the next.
    """
    everything = range(len(traffic.outlines))
    looked_into = _looked_into(traffic, speaker, ear, chance)
    whole = [number for number in everything if number not in looked_into]
    if whole and looked_into and Sightings(traffic, ear.of_anybody, looked_into).may_end_elsewhere():
        return Sightings(traffic, ear.wanted, everything), False
    return Sightings(traffic, ear.wanted, looked_into, whole), bool(whole)


def _looked_into(traffic: Traffic, speaker: Partner, ear: Ear, chance: Random) -> list[int]:
    """Return the telegrams of the traffic that the listener does not read whole."""
    return [
        number
        for number in range(len(traffic.outlines))
        if not ear.of_anybody or not _is_read_whole(traffic, number, speaker, ear, chance)
    ]


def _is_read_whole(traffic: Traffic, number: int, speaker: Partner, ear: Ear, chance: Random) -> bool:
    outline = traffic.outlines[number]
    seen = 0
    for _ in range(_READ_WHOLE):
        content = any_telegram(outline, chance)
        data = None if content is None else speaker.settled(content, outline)
        if data is None:
            continue
        seen += 1
        if not ear.reader.reads_whole(heard(data, speaker.settings, ear.settings)):
            return False
    return seen > 0
