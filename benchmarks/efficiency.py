"""Bus efficiency, gap and processor time: the share of the wire's capacity that one line achieves, and its cost."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from statistics import median
from typing import TYPE_CHECKING

from clients import reading, run_reference
from conversation import READS, record_conversation
from lines import mostly, undisturbed
from report import Figure, Section
from yardstick import waking_slowness

if TYPE_CHECKING:
    from clients import Ran
    from conversation import Conversation
    from equipment import Equipment

_WAYS = ("C", "bare Python", "blocking", "asyncio")
_OURS = ("blocking", "asyncio")
# Promise and floor with the pauses that the protocols require.
_GOALS = {
    "blocking": {9600: (0.994, 0.985), 19200: (0.992, 0.985), 38400: (0.990, 0.985), 115200: (0.985, 0.975)},
    "asyncio": {9600: (0.988, 0.982), 19200: (0.990, 0.982), 38400: (0.980, 0.975), 115200: (0.980, 0.965)},
}
# Without pauses: the rate of the best comparable library. Floors are shares of the C client in the same run.
_PROMISED = {
    "blocking": {9600: 0.994, 19200: 0.990, 38400: 0.990, 115200: 0.980},
    "asyncio": {9600: 0.988, 19200: 0.987, 38400: 0.980, 115200: 0.970},
}
_PROMISED_OF_C = 0.985
_FLOOR_OF_C = {"blocking": (0.985, 0.97), "asyncio": (0.98, 0.96)}
_GAP_US = {"blocking": 25.0, "asyncio": 50.0}
_MOST_TIMES_C = 3.0
_FLOOR_TIMES_C = {"blocking": 3.0, "asyncio": 4.0}
# If the C client loses more than this part of the allowed loss, its core was busy with other work.
_MOST_LOST_BY_C = 0.75
# The pause of these protocols is only a default of drivecomm, so they are measured without it as well.
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
    cost = Section(
        title="Processor time of an exchange",
        about=(
            "Microseconds of user and system time for one of the reads above, where there is no pause before the next "
            "request (a wait for a pause costs what one chooses to spin). The C client wakes for every character."
        ),
        head=("protocol", "baud", "C client", *_WAYS[1:], *(f"{way} / C" for way in _OURS)),
    )
    for protocol in READS:
        for options in ({}, {"turnaround_s": 0.0}) if protocol in _OWN_PAUSE else ({},):
            for baudrate in equipment.extent.baudrates:
                _one(equipment, record_conversation(protocol, baudrate, **options), efficiency, gap, cost)
    return [efficiency, gap, cost]


def _one(equipment: Equipment, conversation: Conversation, efficiency: Section, gap: Section, cost: Section) -> None:
    seen: dict[tuple[str, str], list[float]] = defaultdict(list)
    disturbed: list[bool] = []
    # Long enough for a dozen exchanges on the slowest line.
    seconds = max(equipment.extent.seconds, 12 * conversation.cycle_s())
    lowest = _GOALS["blocking"][conversation.baudrate][1]
    for repetition in range(equipment.extent.repetitions):
        first = repetition % len(_WAYS)
        turn = _WAYS[first:] + _WAYS[:first]

        def work(paths: list[str], turn: tuple[str, ...] = turn) -> dict[str, Ran]:
            done: dict[str, Ran] = {}
            for way, path in zip(turn, paths, strict=True):
                if way == "C":
                    done[way] = run_reference(equipment.programs.reference_client, conversation, [path], seconds)
                else:
                    done[way] = equipment.master.work(reading(way, conversation, [path], seconds))
            return done

        run = equipment.instrument.measure([conversation.line() for _ in turn], work)
        c_client, bare = run.result["C"], run.result["bare Python"]
        lost = 1 - c_client.rates[0] * conversation.cycle_s()
        disturbed.append(run.disturbed or lost > _MOST_LOST_BY_C * (1 - lowest))
        c_gap = run.gap_us(turn.index("C"))
        for place, way in enumerate(turn):
            ran = run.result[way]
            seen[way, "share"].append(ran.rates[0] * conversation.cycle_s())
            seen[way, "of C"].append(ran.rates[0] / c_client.rates[0])
            seen[way, "of bare"].append(ran.rates[0] / bare.rates[0])
            seen[way, "gap"].append(run.gap_us(place) - conversation.rest_s * 1e6)
            seen[way, "beyond"].append(run.gap_us(place) - c_gap)
            seen[way, "us"].append(ran.processor_us)
            seen[way, "times"].append(ran.processor_us / c_client.processor_us)
    middle = {what: median(undisturbed(values, disturbed)) for what, values in seen.items()}

    def cells(what: str, form: str, ways: tuple[str, ...] = _OURS) -> list[str]:
        return [format(middle[way, what], form) for way in ways]

    pause = f"{conversation.pause_s * 1000:.2g} ms"
    begins = (conversation.protocol, pause, str(conversation.baudrate))
    ideal = f"{1 / conversation.cycle_s():.1f}"
    shares = (*cells("share", ".4f", _WAYS), *cells("of C", ".4f"), *cells("of bare", ".4f"))
    efficiency.rows.append((*begins, ideal, *shares))
    gap.rows.append((*begins, *cells("gap", ".0f", _WAYS), *cells("beyond", "+.0f")))
    if not conversation.pause_s:
        cost.rows.append((begins[0], begins[2], *cells("us", ".0f", _WAYS), *cells("times", ".2f")))
    for way in _OURS:
        figures = _figures(way, conversation, middle)
        for section, figure in zip((efficiency, efficiency, gap, cost), figures, strict=True):
            if figure is not None:
                section.figures.append(replace(figure, disturbed=mostly(disturbed)))


def _figures(
    way: str, conversation: Conversation, middle: dict[tuple[str, str], float]
) -> tuple[Figure, Figure, Figure | None, Figure | None]:
    """Return the figures of the share, of the share of the C client, of the gap, and of the processor time."""
    baudrate = conversation.baudrate
    name = f"{conversation.protocol}, {conversation.pause_s * 1000:.2g} ms, {baudrate}"
    floor = _FLOOR_OF_C[way][baudrate == 115200]
    promised, lowest = _GOALS[way][baudrate]
    if conversation.options:
        promised, lowest = _PROMISED[way][baudrate], floor * min(middle["C", "share"], 1.0)
    share = Figure(
        name=f"{way} share of ideal, {name}",
        value=middle[way, "share"],
        promise=promised,
        floor=lowest,
    )
    of_c = Figure(
        name=f"{way} share of C client, {name}",
        value=middle[way, "of C"],
        promise=max(_PROMISED_OF_C, floor),
        floor=floor,
    )
    gap = cost = None
    if baudrate == 115200:
        gap = Figure(
            name=f"{way} gap beyond the C client's in us, {name}",
            value=middle[way, "beyond"],
            promise=_GAP_US[way],
            floor=2 * _GAP_US[way] * waking_slowness(middle["bare Python", "us"]),
            better="less",
        )
    if not conversation.pause_s:
        cost = Figure(
            name=f"{way} processor time in times the C client's, {conversation.protocol}, {baudrate}",
            value=middle[way, "times"],
            promise=_MOST_TIMES_C,
            floor=_FLOOR_TIMES_C[way],
            better="less",
        )
    return share, of_c, gap, cost
