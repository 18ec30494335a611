"""The drives of a capture as one virtual drive, which repeats the recorded answer to each request.

with Server([RecordedDrive(read_capture("pumps.jsonl"))], parse_listen("pty:/tmp/line")) as server:
    server.run(stop)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from drivecomm.errors import NotSupported, TelegramError, UsageError
from drivecomm.protocol import Framed, LineSettings, Motor, VirtualReply
from drivecomm.traffic.replay.exchanges import recorded_exchanges

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from drivecomm.capture import Capture
    from drivecomm.protocol import Codec, Damaged, Direction, Message
    from drivecomm.traffic.replay.exchanges import RecordedExchange

# A master on a network may deliver one telegram in pieces.
_GAP_S = 0.05


@dataclass(frozen=True, slots=True)
class RecordedRequest:
    """A captured request, known by its bytes only."""

    kind: ClassVar[str] = "recorded"
    data: bytes


class RecordedCodec:
    """A codec for the requests of a capture, which it recognises byte for byte."""

    def __init__(self, requests: Iterable[bytes]) -> None:
        self._requests = frozenset(requests)
        self._lengths = sorted({len(request) for request in self._requests}, reverse=True)
        self._begun: dict[bytes, int] = {}
        """Length of the longest request that begins with these bytes, for each incomplete beginning."""
        for request in self._requests:
            for length in range(1, len(request)):
                head = request[:length]
                self._begun[head] = max(self._begun.get(head, 0), len(request))

    def measure(self, head: bytes, direction: Direction) -> int:
        """Return the length of the request that begins with these bytes; 0 for an unknown request and for any reply."""
        if direction != "request" or not self._lengths:
            return 0
        if not head:
            return self._lengths[-1]
        if head in self._begun:
            return self._begun[head]
        return next((n for n in self._lengths if n <= len(head) and head[:n] in self._requests), 0)

    def decode(self, data: bytes, direction: Direction) -> RecordedRequest:
        """Return the request. Raises TelegramError for bytes that are not in the capture."""
        if direction != "request" or data not in self._requests:
            raise TelegramError("framing", "these bytes are not a request in the capture")
        return RecordedRequest(data)

    def encode(self, message: Message) -> bytes:
        """Return the bytes of the request. Raises TelegramError for any other message."""
        if not isinstance(message, RecordedRequest):
            raise TelegramError("field", f"a {message.kind} is not a request in the capture")
        return message.data


def recorded_drives(capture: Capture) -> list[RecordedDrive]:
    """Return the drives of a capture, one for each set of line settings. Raises UsageError if it holds no request.

    Each request gets its recorded answers in order; the last one is repeated. A request that had no answer, or that is
    not in the capture, gets none. An answer is complete as long after its request as in the capture.
    """
    asked: dict[LineSettings, list[RecordedExchange]] = {}
    for each in recorded_exchanges(capture):
        asked.setdefault(each.settings or LineSettings(), []).append(each)
    if not asked:
        raise UsageError("this capture contains no request, so there is nothing to answer")
    return [RecordedDrive(conversation, settings) for settings, conversation in asked.items()]


class RecordedDrive:
    """All drives of a capture that share these line settings, as one; made by `recorded_drives`."""

    def __init__(self, conversation: Iterable[RecordedExchange], settings: LineSettings) -> None:
        answers: dict[bytes, list[VirtualReply | None]] = {}
        for each in conversation:
            reply = VirtualReply(data=each.reply, delay_s=each.reply_s) if each.parts else None
            answers.setdefault(each.request, []).append(reply)
        self.address = 0
        self.settings = settings
        self.gap_s = _GAP_S
        self.motor = Motor()
        self._answers: Mapping[bytes, list[VirtualReply | None]] = answers
        self.codec: Codec = RecordedCodec(answers)
        """Codec of the requests in the capture."""

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:  # noqa: ARG002 - part of the interface
        """Return the next recorded answer to a request; None if it had none."""
        if not isinstance(find, Framed):
            return None
        answers = self._answers[find.data]
        return answers.pop(0) if len(answers) > 1 else answers[0]

    def peek(self, parameter: str, now: float) -> int | str:  # noqa: ARG002 - part of the interface
        """Raise NotSupported: a recording holds no parameters."""
        raise NotSupported(f"a recorded drive holds no parameters, so {parameter} has no value")

    def poke(self, parameter: str, raw: Any) -> None:
        """Raise NotSupported: a recording holds no parameters."""
        raise NotSupported(f"a recorded drive holds no parameters, so {parameter} cannot become {raw!r}")

    def trip(self, code: int, now: float) -> None:
        """Raise NotSupported: a recording only repeats itself."""
        raise NotSupported(
            f"a recorded drive cannot trip with {code} at {now:g} s; it only repeats what it did in the capture"
        )
