"""Many lines in one process, with threads and with asyncio."""

from __future__ import annotations

from collections import defaultdict
from statistics import mean, median
from typing import TYPE_CHECKING

from clients import reading
from compiling import CannotMeasureError
from conversation import learn
from lines import mostly, undisturbed
from report import Figure, Section
from yardstick import slowness

if TYPE_CHECKING:
    from conversation import Conversation
    from equipment import Equipment

_WAYS = ("threads", "asyncio")
_MEAN = {"threads": (0.92, 0.90), "asyncio": (0.95, 0.93)}
_SLOWEST_AT_19200 = (0.985, 0.965)
_MOST_US = (60.0, 90.0)
_SPREAD_S = 0.0005


def measure(equipment: Equipment) -> list[Section]:
    """Measure one process with 1, 16 and 64 lines."""
    section = Section(
        title="Many lines in one process",
        about=(
            "Fuji telegrams of 16 characters without a pause, a drive on each line that answers after 1.5 to 2.5 ms "
            "(evenly spread), whole replies delivered when their last character has passed. threads: a thread and a "
            "blocking bus for each line. asyncio: a task for each. The share of what physics allows, mean over the "
            "lines and slowest line; processor time of one exchange."
        ),
        head=("lines", "baud", "ideal/s", "way", "exchanges/s", "mean", "slowest line", "us per exchange", "of a core"),
    )
    for count in equipment.extent.line_counts:
        for baudrate in (19200, 115200):
            for way in _WAYS:
                try:
                    _one(equipment, section, way, count, learn("fuji", baudrate, turnaround_s=0.0))
                except CannotMeasureError as error:
                    section.remarks.append(str(error))
    return [section]


def _one(equipment: Equipment, section: Section, way: str, count: int, conversation: Conversation) -> None:
    seen: dict[str, list[float]] = defaultdict(list)
    disturbed: list[bool] = []
    seconds = max(1.0, equipment.extent.seconds)
    lines = [conversation.line(spread_s=_SPREAD_S, whole=True) for _ in range(count)]
    for _ in range(equipment.extent.repetitions):
        run = equipment.instrument.measure(
            lines, lambda paths: equipment.master.work(reading(way, conversation, paths, seconds))
        )
        disturbed.append(run.disturbed)
        shares = [rate * conversation.cycle_s() for rate in run.result.rates]
        seen["mean"].append(mean(shares))
        seen["slowest"].append(min(shares))
        seen["cost"].append(run.result.processor_us)
        seen["rate"].append(sum(run.result.rates))
    middle = {name: median(undisturbed(values, disturbed)) for name, values in seen.items()}
    section.rows.append(
        (
            str(count),
            str(conversation.baudrate),
            f"{count / conversation.cycle_s():.0f}",
            way,
            f"{middle['rate']:.0f}",
            f"{middle['mean']:.4f}",
            f"{middle['slowest']:.4f}",
            f"{middle['cost']:.0f}",
            f"{middle['cost'] * middle['rate'] / 1e4:.0f} %",
        )
    )
    if count != 64:
        return
    name = f"{way}, 64 lines, {conversation.baudrate}"
    if conversation.baudrate == 19200:
        promise, floor = _SLOWEST_AT_19200
        section.figures.append(
            Figure(
                name=f"slowest line, {name}",
                value=middle["slowest"],
                promise=promise,
                floor=floor,
                disturbed=mostly(disturbed),
            )
        )
        return
    promise, floor = _MEAN[way]
    most, most_floor = _MOST_US
    section.figures += [
        Figure(
            name=f"share of ideal, {name}",
            value=middle["mean"],
            promise=promise,
            floor=floor,
            disturbed=mostly(disturbed),
        ),
        Figure(
            name=f"us per exchange, {name}",
            value=middle["cost"],
            promise=most,
            floor=most_floor * slowness(),
            better="less",
            disturbed=mostly(disturbed),
        ),
    ]
