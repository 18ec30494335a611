"""What was said before is known by its bytes: it is not read again, and believed no further than it was."""

from dataclasses import dataclass
from typing import ClassVar

import pytest

import drivecomm
from drivecomm.errors import NoReplyError, TelegramError
from drivecomm.link.peer import _MOST_KNOWN, _MOST_WRITTEN, Written
from drivecomm.protocol.schema import Telegrams
from drivecomm.virtual import VirtualLine, virtual_drive


@pytest.fixture
def decoded(monkeypatch):
    """Return the replies that were read, byte by byte."""
    replies = []
    decode = Telegrams.decode

    def noted(codec, data, direction):
        if direction == "reply":
            replies.append(data)
        return decode(codec, data, direction)

    monkeypatch.setattr(Telegrams, "decode", noted)
    return replies


def test_a_reply_that_came_before_is_not_read_again(decoded):
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1, model="agile")
        first, *others = [drive.read("480") for _ in range(5)]
        assert {each.value for each in others} == {first.value}
        # The first exchange of all goes the long way.
        master = [data for data in decoded if len(data) > 3]
        drive.write("480", first.value + 1)
        assert drive.read("480").value == first.value + 1
        assert drive.read("480").value == first.value + 1
    assert len([data for data in decoded if len(data) > 3]) == len(master) + 1
    assert len(master) == 2


def test_each_reading_has_its_own_time():
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1)
        readings = [drive.read("480") for _ in range(4)]
    times = [each.time_s for each in readings]
    assert times == sorted(set(times))


def test_what_two_masters_make_of_the_same_bytes_may_differ(decoded):
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        for drive in [bus.drive("vabus", 1), bus.drive("vabus", 1)] * 3:
            drive.read("480")
    # Each its own; the first exchange of all goes the long way, and knows nothing.
    assert len([data for data in decoded if len(data) > 3]) == 3


def test_a_known_reply_to_something_else_is_not_believed():
    line = VirtualLine([virtual_drive("vabus", 1)])
    replayed = Replayed()
    line.disturbances.append(replayed)
    with drivecomm.open_bus(line.port, attempts=1) as bus:
        drive = bus.drive("vabus", 1)
        for parameter in ("481", "481", "480", "480"):
            drive.read(parameter)
        replayed.instead = replayed.latest
        for _ in range(2):
            with pytest.raises(NoReplyError, match="differs in"):
                drive.read("481")


def test_no_more_is_known_than_a_drive_says_in_some_seconds():
    line = VirtualLine([virtual_drive("danfoss-fc", 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("danfoss-fc", 1, model="fc300")
        for number in range(_MOST_KNOWN + 10):
            drive.write("3-41", number + 1)
            assert drive.read("3-41").raw == 100 * (number + 1)
            assert len(drive.peer.known) <= _MOST_KNOWN


class Replayed:
    """Lets drives say what they said last, whatever they are asked."""

    latest = b""
    instead = b""

    def request(self, data, now):  # noqa: ARG002 - signature of a disturbance
        return [(0.0, data)]

    def reply(self, data, drive, now):  # noqa: ARG002
        self.latest = self.instead or data
        return [(0.0, self.latest)]


@dataclass(frozen=True, kw_only=True)
class Note:
    kind: ClassVar[str] = "note"
    value: object = None


def test_a_telegram_is_written_once_for_each_message_object():
    calls = []

    def write(message):
        calls.append(message)
        if message.value == "bad":
            raise TelegramError("field", "no")
        return str(message.value).encode()

    written = Written(write)
    first, equal = Note(value=1), Note(value=True)
    assert first == equal
    assert [written.telegram(note) for note in (first, equal, first, equal)] == [b"1", b"True", b"1", b"True"]
    assert len(calls) == 2
    for _ in range(2):
        with pytest.raises(TelegramError):
            written.telegram(Note(value="bad"))
    for number in range(2000):
        assert written.telegram(Note(value=number)) == str(number).encode()
    assert len(written._kept) <= _MOST_WRITTEN
