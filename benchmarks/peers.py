"""Modbus libraries on the same lines, for users who know them."""

from __future__ import annotations

from collections import defaultdict
from statistics import mean, median
from typing import TYPE_CHECKING

from clients import Job, run_reference
from compiling import CannotMeasureError
from conversation import Conversation
from lines import MeasurementError
from report import Section

if TYPE_CHECKING:
    from clients import Ran
    from equipment import Equipment

_WAYS = ("C", "minimalmodbus", "pymodbus", "pymodbus asyncio")
# Read holding register 0 of unit 1; it holds 5.
_REQUEST = bytes.fromhex("010300000001840a")
_REPLY = bytes.fromhex("01030200057847")


def modbus(baudrate: int) -> Conversation:
    """Return what is said on a line when a register is read."""
    return Conversation(protocol="modbus", parameter="0", baudrate=baudrate, bits=10, request=_REQUEST, reply=_REPLY)


def measure(equipment: Equipment) -> list[Section]:
    """Measure one line at every speed, and many lines at 115200 baud."""
    section = Section(
        title="Modbus libraries on the same lines",
        about=(
            "Modbus RTU, one register, 8N1, 2 ms until the reply; the share of wire time plus 2 ms, and processor "
            "microseconds of one exchange. minimalmodbus keeps the silent interval of Modbus and is bound to be "
            "slower than this ideal; the C client and pymodbus do not keep it, or not on purpose."
        ),
        head=("lines", "baud", *(f"{way}{what}" for way in _WAYS for what in ("", ", us"))),
    )
    cases = [(1, baudrate) for baudrate in equipment.extent.baudrates]
    cases += [(count, 115200) for count in equipment.extent.peer_line_counts]
    for count, baudrate in cases:
        _one(equipment, section, count, baudrate)
    return [section]


def _one(equipment: Equipment, section: Section, count: int, baudrate: int) -> None:
    conversation = modbus(baudrate)
    seconds = max(equipment.extent.seconds, 1.0 if count > 1 else 0.0)
    shares: dict[str, list[float]] = defaultdict(list)
    costs: dict[str, list[float]] = defaultdict(list)

    def work(paths: list[str]) -> dict[str, Ran]:
        done: dict[str, Ran] = {}
        for place, way in enumerate(_WAYS):
            own = paths[place * count : (place + 1) * count]
            if way == "C":
                wake = "byte" if count == 1 else "reply"
                done[way] = run_reference(equipment.programs.reference_client, conversation, own, seconds, wake)
                continue
            try:
                done[way] = equipment.master.work(Job(way=way, paths=own, baudrate=baudrate, seconds=seconds))
            except (CannotMeasureError, MeasurementError) as error:
                section.remarks.append(str(error))
        return done

    lines = [conversation.line(whole=count > 1) for _ in range(count * len(_WAYS))]
    for _ in range(equipment.extent.repetitions):
        for way, ran in equipment.instrument.measure(lines, work).result.items():
            shares[way].append(mean(ran.rates) * conversation.cycle_s())
            costs[way].append(ran.processor_us)
    cells = []
    for way in _WAYS:
        cells += [f"{median(shares[way]):.3f}", f"{median(costs[way]):.0f}"] if shares[way] else ["", ""]
    section.rows.append((str(count), str(baudrate), *cells))
