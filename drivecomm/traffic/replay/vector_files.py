"""Vector files from a capture: each valid telegram once, with its source."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import starmap
from typing import TYPE_CHECKING, Any

from drivecomm.errors import TelegramError
from drivecomm.protocol import Framed, Framer, fields_of, installed
from drivecomm.tomlfile import toml_line, toml_value
from drivecomm.traffic.replay.exchanges import infer_sources

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.capture import Capture, Piece, Provenance
    from drivecomm.protocol import Codec, Direction, Find, Message, Protocol

_FORMAT = 2
_WAYS: dict[str, Direction] = {"master": "request", "drive": "reply"}


@dataclass(frozen=True, slots=True, kw_only=True)
class CapturedTelegram:
    """A sound telegram of a capture. answers: for a reply, the bytes of the request that it answers, else empty."""

    direction: Direction
    data: bytes
    message: Message
    answers: bytes = b""


def heard_telegrams(capture: Capture, plugin: Protocol, options: Mapping[str, Any]) -> list[CapturedTelegram]:
    """Return the sound telegrams of one protocol in a capture, in order. options: protocol options for its codec."""
    codec = plugin.codec(plugin.options(**options))
    # With the other protocols present, parts of their telegrams are not mistaken for telegrams of this one.
    told = infer_sources(capture, [plugin, *(other for other in installed.working() if other.name != plugin.name)])
    found: list[CapturedTelegram] = []
    for line in dict.fromkeys(piece.line for piece in told.pieces):
        found += _of_one_line([piece for piece in told.pieces if piece.line == line], plugin, codec)
    return found


def vectors_text(capture: Capture, plugin: Protocol, *, name: str, options: Mapping[str, Any]) -> str:
    """Return the text of a vector file with each different telegram of one protocol in a capture.

    name: name of the capture in the source of a vector. options: protocol options for the codec, written to each
    vector.
    """
    codec = plugin.codec(plugin.options(**options))
    source = _source(capture.provenance, name)
    lines = [f"format = {_FORMAT}", f"protocol = {toml_value(plugin.name)}"]
    counts: dict[str, int] = {}
    heard = heard_telegrams(capture, plugin, options)
    for direction, data, answers in dict.fromkeys((each.direction, each.data, each.answers) for each in heard):
        message = codec.decode(data, direction)
        counts[message.kind] = number = counts.get(message.kind, 0) + 1
        entry: dict[str, Any] = {
            "id": f"captured-{direction}-{message.kind}-{number}",
            "source": source,
            "printed": False,
            "direction": direction,
            "hex": data.hex(" ").upper(),
            "valid": True,
        }
        if not _is_canonical(codec, message, data):
            entry["canonical"] = False
        if options:
            entry["options"] = dict(options)
        if direction == "request" and _has_no_address_of_its_own(message, plugin):
            entry["reply_expected"] = False
        if answers:
            entry |= {"answers_to": answers.hex(" ").upper(), "answers": True}
        lines += ["", "[[vector]]", *starmap(toml_line, entry.items()), "[vector.fields]"]
        lines += starmap(toml_line, fields_of(message).items())
    return "\n".join(lines) + "\n"


def _of_one_line(pieces: list[Piece], plugin: Protocol, codec: Codec) -> Iterator[CapturedTelegram]:
    asked: Framed | None = None
    for direction, find in _framed(pieces, codec, plugin.facts.gap_s):
        if direction == "request":
            asked = find
        is_answer = direction == "reply" and asked is not None and not _differs(plugin, asked, find)
        answers = asked.data if asked is not None and is_answer else b""
        yield CapturedTelegram(direction=direction, data=find.data, message=find.message, answers=answers)


def _framed(pieces: list[Piece], codec: Codec, gap_s: float) -> Iterator[tuple[Direction, Framed]]:
    """Yield the sound telegrams with their directions; a telegram ends at a change of sender or after a pause.

    Telegrams next to stray bytes are left out, because short telegrams occur by chance in those of other protocols.
    """
    framer, speaking, heard_at = Framer(codec, "request"), "", 0.0
    finds: list[Find] = []
    for piece in pieces:
        if piece.source not in _WAYS:
            continue
        if piece.source != speaking or piece.time_s - heard_at > gap_s:
            yield from _sound(speaking, [*finds, *framer.flush()])
            framer, speaking, finds = Framer(codec, _WAYS[piece.source]), piece.source, []
        heard_at = piece.time_s
        finds += framer.feed(piece.data)
        if not framer.begun:
            yield from _sound(speaking, finds)
            finds = []
    yield from _sound(speaking, [*finds, *framer.flush()])


def _sound(source: str, finds: list[Find]) -> Iterator[tuple[Direction, Framed]]:
    """Yield the telegrams sent without a pause, if all the bytes belong to valid telegrams."""
    telegrams = [find for find in finds if isinstance(find, Framed)]
    if len(telegrams) == len(finds):
        for telegram in telegrams:
            yield _WAYS[source], telegram


def _differs(plugin: Protocol, asked: Framed, reply: Framed) -> bool:
    # An echo is recognised by its bytes; the protocol might accept it as a reply.
    return asked.data == reply.data or bool(plugin.mismatch(asked.message, reply.message))


def _is_canonical(codec: Codec, message: Message, data: bytes) -> bool:
    try:
        return codec.encode(message) == data
    except TelegramError:
        return False


def _has_no_address_of_its_own(message: Message, plugin: Protocol) -> bool:
    """Whether no drive answers this message: it is a broadcast, or it carries no address."""
    return getattr(message, "address", None) in (None, plugin.broadcast_address)


def _source(provenance: Provenance, name: str) -> str:
    parts = [f"captured in {name}"]
    if provenance.began is not None:
        parts.append(provenance.began.isoformat(timespec="seconds"))
    parts += [f"at {provenance.port}"] if provenance.port else []
    parts += [f"by {provenance.tool}"] if provenance.tool else []
    parts += [provenance.note] if provenance.note else []
    return ", ".join(parts)
