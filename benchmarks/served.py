"""Replies per second of virtual drives, in memory and served over pseudo-terminals."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from clients import run_reference
from conversation import READS, record_conversation
from cores import on_emulator_core
from lines import MeasurementError
from report import Figure, Section
from yardstick import slowness

from drivecomm.virtual import Station, virtual_drive

if TYPE_CHECKING:
    from clients import Ran
    from conversation import Conversation
    from equipment import Equipment

_PROMISE, _FLOOR = 25_000.0, 20_000.0
# Protocols whose drives can be set to answer without any delay.
_SERVED = ("vabus", "vlt3500")
_LINES = (1, 16)
_CALLS = 2000


def measure(equipment: Equipment) -> list[Section]:
    """Measure each protocol in memory, and some of them over pseudo-terminals with a master in C."""
    section = Section(
        title="Virtual drives",
        about=(
            "Replies a second of one process. In memory: telegrams handed to a drive's ear one after the other. Over "
            "pseudo-terminals: served without pacing and with no reply delay, a thread for each line, the C client "
            "asking as fast as it gets answers; the master and the pseudo-terminal count, too."
        ),
        head=("protocol", "in memory", *(f"{count} served" for count in _LINES)),
    )
    for protocol in READS:
        conversation = record_conversation(protocol, 115200)
        memory = median(_in_memory(conversation) for _ in range(equipment.extent.repetitions))
        cells = [f"{memory:.0f}"]
        for count in _LINES:
            if protocol not in _SERVED:
                cells.append("")
                continue
            rates = [_over_terminals(equipment, conversation, count) for _ in range(equipment.extent.repetitions)]
            cells.append(f"{median(rates):.0f}")
        section.rows.append((protocol, *cells))
        section.figures.append(
            Figure(name=f"replies a second, {protocol}", value=memory, promise=_PROMISE, floor=_FLOOR / slowness())
        )
    return [section]


def _in_memory(conversation: Conversation) -> float:
    station = Station(virtual_drive(conversation.protocol, 1, baudrate=conversation.baudrate))
    request = conversation.closing + conversation.request
    at = 0.0
    began = time.process_time()
    for _ in range(_CALLS):
        at += 0.01
        if len(station.hear(request, at - 0.002, at)) != 1:
            raise MeasurementError(f"a virtual {conversation.protocol} drive did not answer")
    return _CALLS / (time.process_time() - began)


def _over_terminals(equipment: Equipment, conversation: Conversation, count: int) -> float:
    script = Path(__file__).with_name("serving_process.py")
    with TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [*on_emulator_core(), sys.executable, str(script), conversation.protocol, str(count), folder],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            if process.stdout is None:
                raise MeasurementError("the server has no pipes")
            paths = json.loads(process.stdout.readline())
            ran = _ask(equipment, conversation, paths)
        finally:
            process.communicate(timeout=10)
    return sum(ran.rates)


def _ask(equipment: Equipment, conversation: Conversation, paths: list[str]) -> Ran:
    program = equipment.programs.reference_client
    return run_reference(program, conversation.without_pause(), paths, equipment.extent.seconds, "reply")
