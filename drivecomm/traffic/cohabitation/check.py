"""The cohabitation check: finds for each pair of drives which telegrams one can mistake in the traffic of the other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from random import Random
from typing import TYPE_CHECKING

from drivecomm.traffic.cohabitation import explanations
from drivecomm.traffic.cohabitation.drives import line_drives_of
from drivecomm.traffic.cohabitation.explanations import advice
from drivecomm.traffic.cohabitation.outlines import as_usual
from drivecomm.traffic.cohabitation.sampling import any_telegram
from drivecomm.traffic.cohabitation.search import find_proof, try_out
from drivecomm.traffic.cohabitation.traffic_graph import Sightings, TelegramFinder, TrafficGraph, character_map
from drivecomm.traffic.cohabitation.verdicts import MistakeProof, PairVerdict, Safety
from drivecomm.virtual import heard

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.protocol import DriveConfig, LineSettings
    from drivecomm.traffic.cohabitation.drives import LineDrive
    from drivecomm.traffic.cohabitation.outlines import TelegramOutline

_SEED = 1
_READ_WHOLE = 200
"""Number of arbitrary telegrams of each form that a drive of the same protocol must read as a whole."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cohabitation:
    """The result of checking a line.

    drives: for each pair of drives, whether the listening drive can mistake the other's telegrams for its own. master:
    whether the master can mistake a late reply of one drive for that of another. advice: recommendations for the line,
    in sentences.
    """

    drives: tuple[PairVerdict, ...]
    master: tuple[PairVerdict, ...]
    advice: tuple[str, ...]

    @property
    def safe(self) -> bool:
        """Whether each pair of drives is safe: a mistake is excluded, or was not met in any trial."""
        return all(each.safe for each in self.drives)


def check_line(drives: Sequence[DriveConfig]) -> Cohabitation:
    """Check whether drives on one line can mistake each other's telegrams for their own.

    The same drives always give the same result. Raises UsageError for a drive that cannot exist.
    """
    partners = line_drives_of(drives)
    pairs = [(speaker, listener) for speaker in partners for listener in partners if speaker is not listener]
    verdicts = [(speaker, listener, listen(speaker, listener)) for speaker, listener in pairs]
    return Cohabitation(
        drives=tuple(verdict for _, _, verdict in verdicts),
        master=tuple(wait_for(expected, late) for late, expected in pairs),
        advice=tuple(advice(partners, verdicts, _is_excluded)),
    )


def listen(speaker: LineDrive, listener: LineDrive) -> PairVerdict:
    """Check which requests to another drive, and which of its replies, the listener can mistake for its own."""
    return (
        _examine(*_as_listener(speaker, listener)) if not _are_alike(speaker, listener) else _alike(speaker, listener)
    )


def _are_alike(one: LineDrive, other: LineDrive) -> bool:
    """Whether two drives differ only in their addresses, as on any line with drives of one protocol."""
    return one.dialect is other.dialect and one.settings == other.settings and one.address != other.address


def _alike(speaker: LineDrive, listener: LineDrive) -> PairVerdict:
    return PairVerdict(speaker=speaker.name, listener=listener.name, outcome=Safety.SAFE, reason=explanations.ALIKE)


def _as_listener(speaker: LineDrive, listener: LineDrive) -> tuple[LineDrive, Sequence[TelegramOutline], LineListener]:
    related = speaker.dialect.plugin is listener.dialect.plugin
    ear = LineListener(
        name=listener.name,
        settings=listener.settings,
        reader=TelegramFinder(codec=listener.ear, direction="request", means=listener.is_meant),
        wanted=listener.understood,
        of_anybody=listener.dialect.read_as("request") if related else (),
    )
    # The listener rightly accepts broadcasts of its own protocol, so leave them out.
    return speaker, [each for each in speaker.spoken if not (related and each.to_all)], ear


def wait_for(expected: LineDrive, late: LineDrive) -> PairVerdict:
    """Check whether the master can mistake the late reply of one drive for the reply that it expects from another."""
    if _are_alike(late, expected):
        return _alike(late, expected)
    ear = LineListener(
        name=expected.name,
        settings=expected.settings,
        reader=TelegramFinder(codec=expected.dialect.codec, direction="reply", means=expected.is_from),
        wanted=expected.answers,
        of_anybody=expected.dialect.read_as("reply") if expected.dialect.plugin is late.dialect.plugin else (),
    )
    return _examine(late, [each for each in late.spoken if each.direction == "reply"], ear)


@dataclass(frozen=True, slots=True, kw_only=True)
class LineListener:
    """A listener: a drive, or the master waiting for a reply.

    settings: its line settings. wanted: the telegrams that it accepts as its own. of_anybody: the same telegrams with
    any address, if the speaker uses the same protocol; empty otherwise.
    """

    name: str
    settings: LineSettings
    reader: TelegramFinder
    wanted: Sequence[TelegramOutline]
    of_anybody: Sequence[TelegramOutline]


def _examine(speaker: LineDrive, spoken: Sequence[TelegramOutline], ear: LineListener) -> PairVerdict:
    chance = Random(_SEED)  # noqa: S311 - repeatable on purpose
    hears = character_map(speaker.settings, ear.settings)
    proof: MistakeProof | None
    if hears is None:
        proof = try_out(spoken, speaker, ear.settings, ear.reader, chance)
        outcome, reason = (
            (Safety.TAKEN, "") if proof else (Safety.UNHEARD, explanations.unheard_reason(speaker, ear.settings))
        )
    else:
        traffic = TrafficGraph(spoken, hears)
        sightings, whole = _sightings(traffic, speaker, ear, chance)
        # Try telegrams that the listener searches anyway first; the others matter only after lost synchronisation.
        places = [Sightings(traffic, ear.wanted, _looked_into(traffic, speaker, ear, chance)), sightings]
        tried = [each for each in places if sightings.starts and each.starts]
        proofs = (find_proof(each, speaker, ear.settings, ear.reader, chance) for each in tried)
        proof = next((each for each in proofs if each is not None), None)
        if proof is None and sightings.starts:
            usual = replace(ear, wanted=list(map(as_usual, ear.wanted)), of_anybody=list(map(as_usual, ear.of_anybody)))
            left, _ = _sightings(TrafficGraph(list(map(as_usual, spoken)), hears), speaker, usual, chance)
            if left.starts:
                outcome, reason = Safety.OPEN, explanations.open_reason(left)
            else:
                outcome, reason = Safety.UNHEARD, explanations.never_read_reason(left)
        else:
            outcome, reason = Safety.SAFE, explanations.safe_reason(sightings, whole=whole)
    if proof is not None:
        outcome, reason = Safety.TAKEN, explanations.taken_reason(proof, speaker.name, ear.name)
    return PairVerdict(speaker=speaker.name, listener=ear.name, outcome=outcome, reason=reason, proof=proof)


def _is_excluded(speaker: LineDrive, listener: LineDrive) -> bool:
    """Whether the telegrams of a speaker can never contain one for the listener, whatever values they carry."""
    _, spoken, ear = _as_listener(speaker, listener)
    hears = character_map(speaker.settings, ear.settings)
    if hears is None:
        return False
    chance = Random(_SEED)  # noqa: S311 - repeatable on purpose
    return not _sightings(TrafficGraph(spoken, hears), speaker, ear, chance)[0].starts


def _sightings(traffic: TrafficGraph, speaker: LineDrive, ear: LineListener, chance: Random) -> tuple[Sightings, bool]:
    """Return the possible places of a telegram, and whether that relies on the listener reading whole telegrams.

    A drive that hears whole telegrams of its own protocol does not search inside them. It does so after losing
    synchronisation, which can happen if a telegram to any address begins inside one telegram and ends in the next.
    """
    everything = range(len(traffic.outlines))
    looked_into = _looked_into(traffic, speaker, ear, chance)
    whole = [number for number in everything if number not in looked_into]
    if whole and looked_into and Sightings(traffic, ear.of_anybody, looked_into).may_end_elsewhere():
        return Sightings(traffic, ear.wanted, everything), False
    return Sightings(traffic, ear.wanted, looked_into, whole), bool(whole)


def _looked_into(traffic: TrafficGraph, speaker: LineDrive, ear: LineListener, chance: Random) -> list[int]:
    """Return the numbers of the outlines that the listener does not read as a whole."""
    return [
        number
        for number in range(len(traffic.outlines))
        if not ear.of_anybody or not _is_read_whole(traffic, number, speaker, ear, chance)
    ]


def _is_read_whole(traffic: TrafficGraph, number: int, speaker: LineDrive, ear: LineListener, chance: Random) -> bool:
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
