"""Many lines in one process, with threads and with asyncio."""

from __future__ import annotations

from collections import defaultdict
from statistics import mean, median
from typing import TYPE_CHECKING

from clients import reading
from compiling import CannotMeasureError
from conversation import learn
from lines import mostly, undisturbed
from peers import modbus
from report import Figure, Section

if TYPE_CHECKING:
    from clients import Ran
    from conversation import Conversation
    from equipment import Equipment

_BARE, _PEER = "bare selectors", "pymodbus asyncio"
_OURS = ("threads", "asyncio")
# On the quiet machine that the promises were made for, at 115200 baud on 64 lines: the shares and the microseconds
# promised, and what the peer reaches there. Where the peer is slower, so may we be.
_SHARE = {"threads": 0.92, "asyncio": 0.95}
_PEER_SHARE = 0.91
_TIMES_PEER = 60 / 52
# At 19200 baud on 64 lines.
_SLOWEST = 0.985
_BARE_SLOWEST = 0.995
_FLOOR = 0.97
_SPREAD_S = 0.0005


def measure(equipment: Equipment) -> list[Section]:
    """Measure one process with 1, 16 and 64 lines."""
    section = Section(
        title="Many lines in one process",
        about=(
            "Fuji telegrams of 16 characters without a pause, a drive on each line that answers after 1.5 to 2.5 ms "
            "(evenly spread), whole replies delivered when their last character has passed. bare selectors: a loop "
            "that writes, reads and compares, and knows nothing else. threads: a thread and a blocking bus for each "
            "line. asyncio: a task for each. pymodbus asyncio: the same with Modbus RTU telegrams of 15 characters. "
            "The share of what physics allows, mean over the lines and slowest line; processor time of one exchange, "
            "also in times that of pymodbus in the same run."
        ),
        head=(
            "lines", "baud", "ideal/s", "way", "exchanges/s", "mean", "slowest line", "us per exchange", "of a core",
            "times pymodbus",
        ),
    )  # fmt: skip
    for count in equipment.extent.line_counts:
        for baudrate in (19200, 115200):
            try:
                _one(equipment, section, count, learn("fuji", baudrate, turnaround_s=0.0))
            except CannotMeasureError as error:
                section.remarks.append(str(error))
    return [section]


def _one(equipment: Equipment, section: Section, count: int, conversation: Conversation) -> None:
    seen: dict[tuple[str, str], list[float]] = defaultdict(list)
    disturbed: list[bool] = []
    spoken = {_BARE: conversation, _PEER: modbus(conversation.baudrate), **dict.fromkeys(_OURS, conversation)}
    lines = [one.line(spread_s=_SPREAD_S, whole=True) for one in spoken.values() for _ in range(count)]

    def work(paths: list[str]) -> dict[str, Ran]:
        done: dict[str, Ran] = {}
        for place, (way, one) in enumerate(spoken.items()):
            own = paths[place * count : (place + 1) * count]
            try:
                done[way] = equipment.master.work(reading(way, one, own, max(1.0, equipment.extent.seconds)))
            except CannotMeasureError as error:
                section.remarks.append(str(error))
        return done

    for _ in range(equipment.extent.repetitions):
        run = equipment.instrument.measure(lines, work)
        disturbed.append(run.disturbed)
        for way, ran in run.result.items():
            shares = [rate * spoken[way].cycle_s() for rate in ran.rates]
            seen[way, "mean"].append(mean(shares))
            seen[way, "slowest"].append(min(shares))
            seen[way, "us"].append(ran.processor_us)
            seen[way, "rate"].append(sum(ran.rates))
            if _PEER in run.result:
                seen[way, "times"].append(ran.processor_us / run.result[_PEER].processor_us)
    middle = {what: median(undisturbed(values, disturbed)) for what, values in seen.items()}
    for way, one in spoken.items():
        if (way, "rate") not in middle:
            continue
        section.rows.append(
            (
                str(count),
                str(one.baudrate),
                f"{count / one.cycle_s():.0f}",
                way,
                f"{middle[way, 'rate']:.0f}",
                f"{middle[way, 'mean']:.4f}",
                f"{middle[way, 'slowest']:.4f}",
                f"{middle[way, 'us']:.0f}",
                f"{middle[way, 'us'] * middle[way, 'rate'] / 1e4:.0f} %",
                f"{middle[way, 'times']:.2f}" if (way, "times") in middle else "",
            )
        )
    if count == max(equipment.extent.line_counts) and (_PEER, "mean") in middle:
        for way in _OURS:
            section.figures += _figures(way, count, conversation.baudrate, middle, disturbed=mostly(disturbed))


def _figures(
    way: str, count: int, baudrate: int, middle: dict[tuple[str, str], float], *, disturbed: bool
) -> list[Figure]:
    name = f"{way}, {count} lines, {baudrate}"
    if baudrate == 19200:
        possible = min(1.0, middle[_BARE, "slowest"] / _BARE_SLOWEST)
        floor, slowest = _FLOOR * _SLOWEST * possible, middle[way, "slowest"]
        return [Figure(name=f"slowest line, {name}", value=slowest, promise=_SLOWEST, floor=floor, disturbed=disturbed)]
    possible = min(1.0, middle[_PEER, "mean"] / _PEER_SHARE)
    return [
        Figure(
            name=f"share of ideal, {name}",
            value=middle[way, "mean"],
            promise=_SHARE[way],
            floor=_FLOOR * _SHARE[way] * possible,
            disturbed=disturbed,
        ),
        Figure(
            name=f"processor time in times pymodbus', {name}",
            value=middle[way, "times"],
            promise=_TIMES_PEER,
            floor=1.5 * _TIMES_PEER,
            better="less",
            disturbed=disturbed,
        ),
    ]
