"""Replies with known bytes are not decoded again, and are checked against their request like any other."""

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
    """Return a list that collects the replies that are decoded."""
    replies = []
    decode = Telegrams.decode

    def noted(codec, data, direction):
        if direction == "reply":
            replies.append(data)
        return decode(codec, data, direction)

    monkeypatch.setattr(Telegrams, "decode", noted)
    return replies


def test_repeated_reply_is_not_decoded_again(decoded):
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1, model="agile")
        first, *others = [drive.read("480") for _ in range(5)]
        assert {each.value for each in others} == {first.value}
        # The first exchange on a line takes the long path.
        master = [data for data in decoded if len(data) > 3]
        drive.write("480", first.value + 1)
        assert drive.read("480").value == first.value + 1
        assert drive.read("480").value == first.value + 1
    assert len([data for data in decoded if len(data) > 3]) == len(master) + 1
    assert len(master) == 2


def test_each_reading_of_a_repeated_reply_has_its_own_time():
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("vabus", 1)
        readings = [drive.read("480") for _ in range(4)]
    times = [each.time_s for each in readings]
    assert times == sorted(set(times))


def test_each_drive_object_decodes_the_same_bytes_itself(decoded):
    line = VirtualLine([virtual_drive("vabus", 1)])
    with drivecomm.open_bus(line.port) as bus:
        for drive in [bus.drive("vabus", 1), bus.drive("vabus", 1)] * 3:
            drive.read("480")
    # One decode per object; the first exchange on a line takes the long path and stores nothing.
    assert len([data for data in decoded if len(data) > 3]) == 3


def test_known_reply_to_another_request_is_not_accepted():
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


def test_known_replies_have_a_limit():
    line = VirtualLine([virtual_drive("danfoss-fc", 1)])
    with drivecomm.open_bus(line.port) as bus:
        drive = bus.drive("danfoss-fc", 1, model="fc300")
        for number in range(_MOST_KNOWN + 10):
            drive.write("3-41", number + 1)
            assert drive.read("3-41").raw == 100 * (number + 1)
            assert len(drive.peer.known) <= _MOST_KNOWN


class Replayed:
    """A disturbance that replaces each reply by `instead` if that is set. latest: the reply sent last."""

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


def test_telegram_is_encoded_once_per_message_object():
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
