"""Many lines in one process: threads, asyncio, a poll plan, and well-known Modbus libraries."""

from __future__ import annotations

from collections import defaultdict
from statistics import mean, median
from typing import TYPE_CHECKING

from clients import reading
from compiling import CannotMeasureError
from conversation import Conversation, record_conversation
from lines import MeasurementError, mostly, undisturbed
from report import Figure, Section

if TYPE_CHECKING:
    from clients import Ran
    from equipment import Equipment

_BARE, _PEER, _POLL, _TASKS, _THREADS = "bare selectors", "pymodbus asyncio", "poll plan", "asyncio", "threads"
_SLOW_PEERS = ("minimalmodbus", "pymodbus")
# At 115200 baud, promise and floor: the share of the ideal rate, and processor time as a multiple of the peer's.
_SHARE = {_POLL: (0.975, 0.96), _TASKS: (0.95, 0.92), _THREADS: (0.92, 0.89)}
_TIMES_PEER = {_POLL: (0.45, 0.55), _TASKS: (0.65, 0.80), _THREADS: (60 / 52, 1.5 * 60 / 52)}
# At 19200 baud waits are long, so no line may fall behind.
_SLOWEST = (0.985, 0.955)
# If even the bare loop gets a smaller share, its core was busy with other work.
_LEAST_OF_BARE = 0.98
_SPREAD_S = 0.0005
# Read holding register 0 of unit 1; it holds 5.
_REQUEST = bytes.fromhex("010300000001840a")
_REPLY = bytes.fromhex("01030200057847")


def measure(equipment: Equipment) -> list[Section]:
    """Measure one process with one line and with many."""
    section = Section(
        title="Many lines in one process",
        about=(
            "Fuji telegrams of 16 characters without a pause, a drive on each line that answers after 1.5 to 2.5 ms "
            "(evenly spread), whole replies delivered when their last character has passed. bare selectors: a loop "
            "that writes, reads and compares, and knows nothing else. threads: a thread and a blocking bus for each "
            "line. asyncio: a task for each. poll plan: `drivecomm.poll` over all lines. Modbus libraries: the same "
            "with Modbus RTU telegrams of 15 characters; minimalmodbus and pymodbus have a thread for each line, and "
            "minimalmodbus keeps the silent interval of Modbus, which the others do not. The share of what physics "
            "allows, mean over the lines and slowest line; processor time of one exchange, also in times that of "
            "pymodbus asyncio in the same run."
        ),
        head=(
            "lines", "baud", "ideal/s", "way", "exchanges/s", "mean", "slowest line", "us per exchange", "of a core",
            "times pymodbus asyncio",
        ),
    )  # fmt: skip
    for count in equipment.extent.line_counts:
        for baudrate in (19200, 115200):
            _one(equipment, section, count, record_conversation("fuji", baudrate, turnaround_s=0.0))
    return [section]


def _modbus(baudrate: int) -> Conversation:
    """Return the telegrams of reading one register."""
    return Conversation(protocol="modbus", parameter="0", baudrate=baudrate, bits=10, request=_REQUEST, reply=_REPLY)


def _one(equipment: Equipment, section: Section, count: int, conversation: Conversation) -> None:
    seen: dict[tuple[str, str], list[float]] = defaultdict(list)
    disturbed: list[bool] = []
    peers = (_PEER, *(_SLOW_PEERS if equipment.extent.slow_peers else ()))
    spoken = {
        _BARE: conversation,
        **dict.fromkeys(peers, _modbus(conversation.baudrate)),
        **dict.fromkeys(_SHARE, conversation),
    }
    lines = [one.line(spread_s=_SPREAD_S, whole=True) for one in spoken.values() for _ in range(count)]

    def work(paths: list[str]) -> dict[str, Ran]:
        done: dict[str, Ran] = {}
        for place, (way, one) in enumerate(spoken.items()):
            own = paths[place * count : (place + 1) * count]
            try:
                done[way] = equipment.master.work(reading(way, one, own, max(1.0, equipment.extent.seconds)))
            except CannotMeasureError as error:
                section.remarks.append(str(error))
            except MeasurementError as error:
                if way not in _SLOW_PEERS:
                    raise
                section.remarks.append(str(error))
        return done

    for _ in range(equipment.extent.repetitions):
        run = equipment.instrument.measure(lines, work)
        for way, ran in run.result.items():
            shares = [rate * spoken[way].cycle_s() for rate in ran.rates]
            seen[way, "share"].append(mean(shares))
            seen[way, "slowest"].append(min(shares))
            seen[way, "us"].append(ran.processor_us)
            seen[way, "rate"].append(sum(ran.rates))
            if _PEER in run.result:
                seen[way, "times"].append(ran.processor_us / run.result[_PEER].processor_us)
        disturbed.append(run.disturbed or seen[_BARE, "share"][-1] < _LEAST_OF_BARE)
    complete = {what: values for what, values in seen.items() if len(values) == len(disturbed)}
    middle = {what: median(undisturbed(values, disturbed)) for what, values in complete.items()}
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
                f"{middle[way, 'share']:.4f}",
                f"{middle[way, 'slowest']:.4f}",
                f"{middle[way, 'us']:.0f}",
                f"{middle[way, 'us'] * middle[way, 'rate'] / 1e4:.0f} %",
                f"{middle[way, 'times']:.2f}" if (way, "times") in middle else "",
            )
        )
    if count == max(equipment.extent.line_counts):
        for way in _SHARE:
            section.figures += _figures(way, count, conversation.baudrate, middle, disturbed=mostly(disturbed))


def _figures(
    way: str, count: int, baudrate: int, middle: dict[tuple[str, str], float], *, disturbed: bool
) -> list[Figure]:
    name = f"{way}, {count} lines, {baudrate}"
    if baudrate == 19200:
        promise, floor = _SLOWEST
        value = middle[way, "slowest"]
        return [Figure(name=f"slowest line, {name}", value=value, promise=promise, floor=floor, disturbed=disturbed)]
    promise, floor = _SHARE[way]
    figures = [
        Figure(
            name=f"share of ideal, {name}",
            value=middle[way, "share"],
            promise=promise,
            floor=floor,
            disturbed=disturbed,
        )
    ]
    if (way, "times") in middle:
        promise, floor = _TIMES_PEER[way]
        figures.append(
            Figure(
                name=f"processor time in times pymodbus asyncio's, {name}",
                value=middle[way, "times"],
                promise=promise,
                floor=floor,
                better="less",
                disturbed=disturbed,
            )
        )
    return figures
