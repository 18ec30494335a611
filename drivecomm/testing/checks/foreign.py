"""Foreign traffic: telegrams of the other installed protocols on the same line are neither believed nor answered."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, FileFormatError, ReplyError, TelegramError
from drivecomm.protocol import Framed, installed
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, expect, raise_all, shown
from drivecomm.testing.checks.framing import finds
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import Protocol
    from drivecomm.testing.bench import Overheard
    from drivecomm.testing.vectors import Vector

_READS = 60


@check("foreign traffic")
def is_not_believed(plugin: Protocol, other: Protocol) -> None:
    """No telegram of another protocol is the answer to any of this one's own requests."""
    codec = plugin.codec(plugin.options())
    requests = [
        codec.decode(vector.data, "request")
        for vector in _own(plugin)
        if vector.direction == "request" and not vector.options
    ]
    wrong = []
    for vector in _own(other):
        try:
            reply = codec.decode(vector.data, "reply")
        except TelegramError:
            continue
        believed = next((request for request in requests if not plugin.mismatch(request, reply)), None)
        if believed is not None:
            wrong.append(f"{shown(vector.data)} of {other.name} ({vector.id}) is taken for the answer to {believed}")
    raise_all(wrong)


@check("foreign traffic")
def is_not_answered(plugin: Protocol, other: Protocol) -> None:
    """No virtual drive answers a telegram of another protocol, or begins to turn its motor because of it."""
    wrong = []
    for address in (plugin.addresses[0], plugin.addresses[1], plugin.addresses[-1]):
        with bench(plugin, addresses=(address,)) as on:
            wrong += [
                f"drive {address} answers {shown(vector.data)} of {other.name} ({vector.id})"
                for vector in _own(other)
                if _answers(on.virtual, vector.data)
            ]
            if on.virtual.motor.running:
                wrong.append(f"the motor of drive {address} runs after telegrams of {other.name}")
    raise_all(wrong)


def _answers(drive: Overheard, data: bytes) -> bool:
    answers = [drive.hear(find, 1.0) for find in finds(drive.codec, "request", [data]) if isinstance(find, Framed)]
    return any(answer is not None for answer in answers)


@check("foreign traffic")
def does_not_spoil_a_reading(plugin: Protocol, other: Protocol) -> None:
    """With telegrams of another protocol on the line before, during and after each request, no reading is wrong."""
    good = tried = 0
    with bench(plugin) as on:
        parameters = [info.address for info in (on.drive.model.parameters.values() if on.drive.model else ())]
        foreign = [vector.data for vector in _own(other)][:: max(1, len(_own(other)) // _READS)]
        for number, data in enumerate(foreign):
            parameter = parameters[number % len(parameters)]
            # Before the request, while it is on its way, and where its answer is expected.
            on.line.call_at(on.line.time + (0.0, 0.002, 0.02)[number % 3], lambda data=data: on.line.inject(data))  # type: ignore[misc]
            tried += 1
            try:
                reading = on.drive.read(parameter)
            except ReplyError:
                on.line.advance(1.0)
                continue
            except DriveCommError:
                continue
            good += 1
            held = on.virtual.peek(parameter, on.line.time)
            expect(
                reading.raw == held,
                f"beside {shown(data)} of {other.name}, {parameter} reads {reading.raw!r}, the drive holds {held!r}",
            )
    expect(good > tried / 3, f"beside telegrams of {other.name} only {good} of {tried} reads come to anything")


def others(plugin: Protocol) -> Iterator[Protocol]:
    """Yield the other installed protocols that ship vectors."""
    for other in installed.working():
        if other.name != plugin.name and _own(other):
            yield other


def _own(plugin: Protocol) -> list[Vector]:
    try:
        return [vector for vector in packaged_vectors(plugin).vectors if vector.valid]
    except FileFormatError:
        # Whoever judges that protocol is told.
        return []
