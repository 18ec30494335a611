"""Busy Python thread beside the bus, with Python's own switch interval and with the recommended one."""

from __future__ import annotations

from collections import defaultdict
from statistics import median
from typing import TYPE_CHECKING

from clients import reading
from compiling import CannotMeasureError
from conversation import record_conversation
from lines import mostly
from report import Figure, Section

if TYPE_CHECKING:
    from clients import Ran
    from equipment import Equipment

RECOMMENDED_S = 0.0001
_PROMISE, _FLOOR = 0.90, 0.85


def measure(equipment: Equipment) -> list[Section]:
    """Measure blocking and asyncio at 19200 baud."""
    section = Section(
        title="A busy neighbour",
        about=(
            "Exchanges a second at 19200 baud (vlt3500, no pause) beside a thread of the same process that only "
            "computes, as a share of those in a quiet process. Recommended: `sys.setswitchinterval(0.0001)`."
        ),
        head=("way", "switch interval", "share of a quiet process"),
    )
    conversation = record_conversation("vlt3500", 19200, turnaround_s=0.0)
    seconds = max(0.5, equipment.extent.seconds)
    cases = {"5 ms (Python's own)": None, "0.1 ms (recommended)": RECOMMENDED_S}
    for way in ("blocking", "asyncio"):
        shares: dict[str, list[float]] = defaultdict(list)
        disturbed: list[bool] = []

        def work(paths: list[str], way: str = way) -> list[Ran]:
            jobs = [reading(way, conversation, paths[:1], seconds)]
            jobs += [
                reading(way, conversation, [path], seconds, neighbour=True, switch_interval_s=interval)
                for path, interval in zip(paths[1:], cases.values(), strict=True)
            ]
            return [equipment.master.work(job) for job in jobs]

        try:
            for _ in range(equipment.extent.repetitions):
                run = equipment.instrument.measure([conversation.line() for _ in range(3)], work)
                disturbed.append(run.disturbed)
                quiet, *beside = run.result
                for name, ran in zip(cases, beside, strict=True):
                    shares[name].append(ran.rates[0] / quiet.rates[0])
        except CannotMeasureError as error:
            section.remarks.append(str(error))
            continue
        section.rows += [(way, name, f"{median(values):.3f}") for name, values in shares.items()]
        recommended = median(shares["0.1 ms (recommended)"])
        section.figures.append(
            Figure(
                name=f"{way} share beside a busy thread",
                value=recommended,
                promise=_PROMISE,
                floor=_FLOOR,
                disturbed=mostly(disturbed),
            )
        )
    return [section]
