"""Processor time of the layers of a read."""

from __future__ import annotations

import time
from collections import defaultdict
from functools import partial
from statistics import mean, median
from typing import TYPE_CHECKING, Any

from canned_port import CannedPort
from clients import reading
from conversation import READS, record_conversation
from report import Figure, Section
from yardstick import yardstick_us

import drivecomm
from drivecomm.testing import play
from drivecomm.virtual import VirtualLine, virtual_drive

if TYPE_CHECKING:
    from collections.abc import Callable

    from clients import Ran
    from conversation import Conversation
    from equipment import Equipment

    from drivecomm.protocol.schema import Form

_YARDSTICKS, _MOST_YARDSTICKS = 10.0, 12.0
_BATCHES, _CALLS = 10, 100


def measure(equipment: Equipment) -> list[Section]:
    """Measure each layer of a read alone, and a whole read on a virtual line."""
    section = Section(
        title="Where the microseconds go",
        about=(
            "Processor microseconds of one read at 19200 baud, layer by layer, each measured alone. encode and decode: "
            "request and reply, by the codec as it is used. declared: the same decode leaf by leaf, as the "
            "form is declared. exchange: the protocol's generator played from a script. without a port: the whole of "
            "`drive.read` on a port that has the reply ready, also in yardsticks; link and the rest is what of it is "
            "neither codec nor exchange. port: what the operating system and waiting for characters add on a "
            "line. on a virtual line: with the line and the drive."
        ),
        head=(
            "protocol", "encode", "decode", "declared", "exchange", "link and the rest", "without a port",
            "in yardsticks", "port", "on a line", "on a virtual line",
        ),
    )  # fmt: skip
    yardsticks = []
    for protocol in READS:
        conversation = record_conversation(protocol, 19200)
        costs: dict[str, list[float]] = defaultdict(list)
        for _ in range(equipment.extent.repetitions):
            for name, cost in _costs(conversation).items():
                costs[name].append(cost)
            costs["yardsticks"].append(costs["without"][-1] / yardstick_us())
            run = equipment.instrument.measure([conversation.line()], partial(_read, equipment, conversation))
            costs["line"].append(run.result.processor_us)
        middle = {name: median(values) for name, values in costs.items()}
        rest = middle["without"] - middle["encode"] - middle["decode"] - middle["exchange"]
        port = middle["line"] - middle["without"]
        cells = (
            middle["encode"], middle["decode"], middle["declared"], middle["exchange"], rest, middle["without"],
            middle["yardsticks"], port, middle["line"], middle["virtual"],
        )  # fmt: skip
        section.rows.append((protocol, *(f"{cell:.1f}" for cell in cells)))
        yardsticks.append(middle["yardsticks"])
    section.figures.append(
        Figure(
            name="read with the reply ready in yardsticks, mean of the protocols",
            value=mean(yardsticks),
            promise=_YARDSTICKS,
            floor=_MOST_YARDSTICKS,
            better="less",
        )
    )
    return [section]


def _read(equipment: Equipment, conversation: Conversation, paths: list[str]) -> Ran:
    return equipment.master.work(reading("blocking", conversation, paths, equipment.extent.seconds))


def _costs(conversation: Conversation) -> dict[str, float]:
    plugin = drivecomm.protocols()[conversation.protocol]
    options = plugin.options()
    codec = plugin.codec(options)
    request = codec.decode(conversation.request, "request")
    reply = codec.decode(conversation.reply, "reply")
    closing = [codec.decode(conversation.closing, "request")] if conversation.closing else []
    operations = plugin.operations(1, options, None)
    script = [(request, reply), *((message, None) for message in closing)]
    form = next((one for one in plugin.forms().values() if _reads(one, conversation.reply, reply)), None)
    costs = {
        "encode": sum(_cost(partial(codec.encode, one)) for one in (request, *closing)),
        "decode": _cost(lambda: codec.decode(conversation.reply, "reply")),
        "declared": _cost(lambda: form.parse_declared(conversation.reply)) if form else float("nan"),
        "exchange": _cost(lambda: play(operations.read(conversation.parameter), script)),
    }
    port = CannedPort(conversation)
    with drivecomm.open_bus(lambda: port, baudrate=conversation.baudrate, **conversation.options) as bus:
        drive = bus.drive(conversation.protocol, 1)
        costs["without"] = _cost(lambda: drive.read(conversation.parameter))
    line = VirtualLine([virtual_drive(conversation.protocol, 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive(conversation.protocol, 1)
        costs["virtual"] = _cost(lambda: drive.read(conversation.parameter))
    return costs


def _reads(form: Form[Any], data: bytes, message: object) -> bool:
    try:
        return bool(form.parse(data) == message)
    except drivecomm.TelegramError:
        return False


def _cost(call: Callable[[], object]) -> float:
    """Return the processor time of a call in microseconds; the minimum of several batches."""
    batches = []
    for _ in range(_BATCHES):
        began = time.process_time()
        for _ in range(_CALLS):
            call()
        batches.append((time.process_time() - began) / _CALLS * 1e6)
    return min(batches)
