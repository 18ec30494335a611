"""Bus efficiency and gap: how much of what the wire allows one line gets, and where the rest is."""

from __future__ import annotations

from collections import defaultdict
from statistics import median
from typing import TYPE_CHECKING

from clients import reading, run_reference
from compiling import CannotMeasureError
from conversation import READS, learn
from goals import one_line
from lines import mostly, undisturbed
from report import Figure, Section
from yardstick import waking_slowness

if TYPE_CHECKING:
    from clients import Ran
    from conversation import Conversation
    from equipment import Equipment

_WAYS = ("C", "bare Python", "blocking", "asyncio")
_OURS = ("blocking", "asyncio")
# Promise and floor with the pauses that the protocols ask for.
_GOALS = {
    "blocking": {9600: (0.994, 0.985), 19200: (0.992, 0.985), 38400: (0.990, 0.985), 115200: (0.985, 0.975)},
    "asyncio": {9600: (0.988, 0.982), 19200: (0.990, 0.982), 38400: (0.980, 0.975), 115200: (0.980, 0.965)},
}
# Without: what the best of the libraries with the same task reach. Floors are shares of the C client in the same run.
_PROMISED = {
    "blocking": {9600: 0.994, 19200: 0.990, 38400: 0.990, 115200: 0.980},
    "asyncio": {9600: 0.988, 19200: 0.987, 38400: 0.980, 115200: 0.970},
}
_PROMISED_OF_C = 0.985
_FLOOR_OF_C = {"blocking": (0.985, 0.97), "asyncio": (0.98, 0.96)}
_GAP_US = {"blocking": 25.0, "asyncio": 50.0}
# Where even the C client loses more than this part of what the floor leaves to lose, its core was busy otherwise.
_MOST_LOST_BY_C = 0.75
# Their pause is only a default of ours, so it is measured without it too.
_OWN_PAUSE = ("vlt3500", "fuji")


def measure(equipment: Equipment) -> list[Section]:
    """Measure every protocol at every speed."""
    efficiency = Section(
        title="Bus efficiency",
        about=(
            "One line, one drive that answers after 2 ms, character by character; `drive.read` again and again. The "
            "share of what physics allows: characters of request and reply, the drive's 2 ms, and the pause that the "
            "protocol asks for before the master speaks again (VABus: and its closing EOT). The C client polls, reads, "
            "compares and keeps the same pause, bare Python does the same and wakes once for a reply; the last columns "
            "are shares of the two in the same run."
        ),
        head=(
            "protocol", "pause", "baud", "ideal/s", "C client", *_WAYS[1:], *(f"{way} / C" for way in _OURS),
            *(f"{way} / bare Python" for way in _OURS),
        ),
    )  # fmt: skip
    gap = Section(
        title="Gap",
        about=(
            "Microseconds from the end of a reply to the beginning of the next request on the wire, beyond the pause "
            "(and the closing telegram) that the protocol asks for; measured by the emulator, median. The C client's "
            "is what a pseudo-terminal costs."
        ),
        head=("protocol", "pause", "baud", "C client", *_WAYS[1:], *(f"{way} - C" for way in _OURS)),
    )
    for protocol in READS:
        for options in equipment.extent.pauses if protocol in _OWN_PAUSE else ({},):
            for baudrate in equipment.extent.baudrates:
                _one(equipment, learn(protocol, baudrate, **options), efficiency, gap)
    return [efficiency, gap]


def _one(equipment: Equipment, conversation: Conversation, efficiency: Section, gap: Section) -> None:
    shares: dict[str, list[float]] = defaultdict(list)
    of_c: dict[str, list[float]] = defaultdict(list)
    gaps: dict[str, list[float]] = defaultdict(list)
    of_bare: dict[str, list[float]] = defaultdict(list)
    bare_us: list[float] = []
    disturbed: list[bool] = []
    # Long enough for a dozen exchanges on the slowest line.
    seconds = max(equipment.extent.seconds, 12 * conversation.cycle_s())
    for repetition in range(equipment.extent.repetitions):
        first = repetition % len(_WAYS)
        turn = _WAYS[first:] + _WAYS[:first]

        def work(paths: list[str], turn: tuple[str, ...] = turn) -> dict[str, Ran]:
            done: dict[str, Ran] = {}
            for way, path in zip(turn, paths, strict=True):
                if way == "C":
                    done[way] = run_reference(equipment.programs.reference_client, conversation, [path], seconds)
                    continue
                try:
                    done[way] = equipment.master.work(reading(way, conversation, [path], seconds))
                except CannotMeasureError as error:
                    efficiency.remarks.append(str(error))
            return done

        run = equipment.instrument.measure([conversation.line() for _ in turn], work)
        lost = 1 - run.result["C"].rates[0] * conversation.cycle_s()
        lowest = _GOALS["blocking"][conversation.baudrate][1]
        disturbed.append(run.disturbed or lost > _MOST_LOST_BY_C * (1 - lowest))
        bare_us.append(run.result["bare Python"].processor_us)
        for place, way in enumerate(turn):
            if way in run.result:
                rate = run.result[way].rates[0]
                shares[way].append(rate * conversation.cycle_s())
                of_c[way].append(rate / run.result["C"].rates[0])
                of_bare[way].append(rate / run.result["bare Python"].rates[0])
                gaps[way].append(run.gap_us(place) - conversation.rest_s * 1e6)
    for values in (shares, of_c, of_bare, gaps):
        for way in values:
            values[way] = undisturbed(values[way], disturbed)
    pause = f"{conversation.pause_s * 1000:.2g} ms"
    name = f"{conversation.protocol}, {pause}, {conversation.baudrate}"
    begins = (conversation.protocol, pause, str(conversation.baudrate))
    efficiency.rows.append(
        (
            *begins,
            f"{1 / conversation.cycle_s():.1f}",
            *(_median(shares[way], ".4f") for way in _WAYS),
            *(_median(of_c[way], ".4f") for way in _OURS),
            *(_median(of_bare[way], ".4f") for way in _OURS),
        )
    )
    beyond = {way: [one - other for one, other in zip(gaps[way], gaps["C"], strict=True)] for way in _WAYS if gaps[way]}
    gap.rows.append(
        (
            *begins,
            *(_median(gaps[way], ".0f") for way in _WAYS),
            *(_median(beyond.get(way, []), "+.0f") for way in _OURS),
        )
    )
    slow = waking_slowness(median(undisturbed(bare_us, disturbed)))
    for way in _OURS:
        if not shares[way]:
            continue
        floor = _FLOOR_OF_C[way][conversation.baudrate == 115200]
        promised, lowest = _GOALS[way][conversation.baudrate]
        if conversation.options:
            promised, lowest = _PROMISED[way][conversation.baudrate], floor * min(median(shares["C"]), 1.0)
        efficiency.figures += [
            Figure(
                name=f"{way} share of ideal, {name}",
                value=median(shares[way]),
                promise=promised,
                floor=lowest,
                disturbed=mostly(disturbed),
                goal="" if conversation.options else one_line(way, conversation.baudrate),
            ),
            Figure(
                name=f"{way} share of C client, {name}",
                value=median(of_c[way]),
                promise=max(_PROMISED_OF_C, floor),
                floor=floor,
                disturbed=mostly(disturbed),
            ),
        ]
        if conversation.baudrate == 115200:
            gap.figures.append(
                Figure(
                    name=f"{way} gap beyond the C client's in us, {name}",
                    value=median(beyond[way]),
                    promise=_GAP_US[way],
                    floor=2 * _GAP_US[way] * slow,
                    better="less",
                    disturbed=mostly(disturbed),
                )
            )


def _median(values: list[float], form: str) -> str:
    return format(median(values), form) if values else ""
