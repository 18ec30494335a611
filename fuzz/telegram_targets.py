"""Fuzz targets for decoders, framers and encoders of every installed protocol, with all options of its vectors.

The first byte of an input selects direction and options; the telegram or the stream follows it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from choices import Choices
from mutation import mutate_bytes
from target import FuzzTarget, PropertyBrokenError, expect

from drivecomm.errors import DriveCommError, TelegramError
from drivecomm.protocol import Framed, Framer, Noise, fields_of
from drivecomm.testing import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivecomm.protocol import Codec, Direction, Find, Protocol

_MOST_HELD = 512
"""Limit of bytes that a framer holds: no telegram is longer, and each new byte makes the framer copy them all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reader:
    """A codec of a protocol with options, for one direction."""

    plugin: Protocol
    options: Any
    direction: Direction

    def codec(self) -> Codec:
        return self.plugin.codec(self.options)


def telegram_targets(plugin: Protocol) -> Iterator[FuzzTarget]:
    """Yield the fuzz targets for the telegrams of a protocol."""
    readers = _readers(plugin)
    sound = _sound(plugin, readers)
    yield _decoder(plugin, readers, sound)
    yield _framer(plugin, readers, sound)
    yield _encoder(plugin)


def _readers(plugin: Protocol) -> list[_Reader]:
    vectors = packaged_vectors(plugin)
    # A list, not a set: options may contain unhashable lists.
    chosen = [plugin.options()]
    for entry in (*vectors.vectors, *vectors.streams):
        options = plugin.options(**entry.options)
        if options not in chosen:
            chosen.append(options)
    directions: tuple[Direction, Direction] = ("request", "reply")
    return [
        _Reader(plugin=plugin, options=options, direction=direction) for options in chosen for direction in directions
    ]


def _sound(plugin: Protocol, readers: list[_Reader]) -> tuple[bytes, ...]:
    """Return the telegrams and streams of the vectors, each after the byte that selects its reader."""
    vectors = packaged_vectors(plugin)
    found = [
        bytes([readers.index(_Reader(plugin=plugin, options=plugin.options(**each.options), direction=each.direction))])
        + each.data
        for each in (*vectors.vectors, *vectors.streams)
    ]
    return tuple(dict.fromkeys(found))


def _decoder(plugin: Protocol, readers: list[_Reader], seeds: tuple[bytes, ...]) -> FuzzTarget:
    # Decoders are reused for all inputs; only framers keep state between inputs.
    codecs = [(reader.codec(), reader.direction) for reader in readers]

    def check(data: bytes) -> None:
        if not data:
            return
        codec, direction = codecs[data[0] % len(codecs)]
        telegram = data[1:]
        try:
            message = codec.decode(telegram, direction)
        except TelegramError:
            return
        expect(codec.measure(telegram, direction) >= len(telegram), "a sound telegram that a framer cuts off earlier")
        fields_of(message)
        try:
            written = codec.encode(message)
        except TelegramError:
            # A decoder may accept forms that the encoder never produces.
            return
        try:
            read = codec.decode(written, direction)
        except TelegramError as error:
            if _repeats_its_beginning(written):
                # A telegram that repeats its beginning looks like a restarted one, which a receiver may refuse.
                return
            where = f"what was decoded is encoded as {written.hex(' ')}"
            raise PropertyBrokenError(f"{where}, and that is refused: {error}") from error
        expect(read == message, "what was decoded says something else when encoded again")
        expect(codec.encode(read) == written, "a canonical telegram is not encoded as it was")

    return FuzzTarget(name=f"{plugin.name}-decoder", check=check, seeds=seeds, mutate=mutate_bytes)


def _repeats_its_beginning(telegram: bytes) -> bool:
    return telegram.find(telegram[:3], 1) > 0


def _framer(plugin: Protocol, readers: list[_Reader], sound: tuple[bytes, ...]) -> FuzzTarget:
    def check(data: bytes) -> None:
        if len(data) < 2:
            return
        reader, size, stream = readers[data[0] % len(readers)], 1 + data[1] % 24, data[2:]
        whole = _finds(reader, stream, len(stream) or 1)
        pieces = _finds(reader, stream, size)
        expect(_joined(whole) == _joined(pieces), f"whole it finds {whole}, in pieces of {size} it finds {pieces}")

    rows = [seed[:1] + bytes([place]) + seed[1:] * 2 for place, seed in enumerate(sound) if place < 256]
    # A telegram beginning that never ends.
    floods = [seed[:1] + b"\x00" + seed[1:6] + seed[5:6] * 1000 for seed in sound[:3]]
    return FuzzTarget(name=f"{plugin.name}-framer", check=check, seeds=(*rows, *floods), mutate=mutate_bytes)


def _finds(reader: _Reader, stream: bytes, size: int) -> list[Find]:
    framer = Framer(reader.codec(), reader.direction)
    found: list[Find] = []
    for start in range(0, len(stream), size):
        found += framer.feed(stream[start : start + size])
        expect(framer.held <= _MOST_HELD, f"{framer.held} bytes are kept, more than any telegram has")
        expect(framer.missing > 0, "a framer that is missing nothing waits for nothing")
    found += framer.flush()
    expect(not framer.held, "bytes are kept behind a gap")
    return found


def _joined(finds: list[Find]) -> list[tuple[str, bytes]]:
    """Return finds in a comparable form: adjacent noise is joined, and errors are replaced by their texts."""
    joined: list[tuple[str, bytes]] = []
    for find in finds:
        if isinstance(find, Noise):
            if joined and joined[-1][0] == "noise":
                joined[-1] = ("noise", joined[-1][1] + find.data)
            else:
                joined.append(("noise", find.data))
        else:
            joined.append((str(find.message if isinstance(find, Framed) else find.error), find.data))
    return joined


def _encoder(plugin: Protocol) -> FuzzTarget:
    """Return the target that encodes changed fields of a vector; the result must decode to the same message."""
    vectors = packaged_vectors(plugin)
    examples = [(each, plugin.options(**each.options)) for each in vectors.vectors if each.valid]
    names = sorted({name for each, _ in examples for name in each.fields})
    values = [value for each, _ in examples for value in each.fields.values()]

    def check(data: bytes) -> None:
        choices = Choices(data)
        vector, options = choices.one_of(examples)
        fields: dict[str, Any] = dict(vector.fields)
        for _ in range(1 + choices.below(3)):
            name = choices.one_of(names)
            fields[name] = choices.one_of(values) if choices.below(2) else choices.value()
            if choices.below(16) == 0:
                del fields[name]
        _written_and_read(plugin, plugin.codec(options), fields, vector.direction)

    seeds = tuple(each.data for each, _ in examples)
    return FuzzTarget(name=f"{plugin.name}-encoder", check=check, seeds=seeds, mutate=mutate_bytes)


def _written_and_read(plugin: Protocol, codec: Codec, fields: Mapping[str, Any], direction: Direction) -> None:
    try:
        message = plugin.message(fields, direction)
        written = codec.encode(message)
    except DriveCommError:
        return
    try:
        again = codec.decode(written, direction)
    except TelegramError as error:
        where = f"the fields {fields} are written as {written.hex(' ')}"
        raise PropertyBrokenError(f"{where}, and that is refused: {error}") from error
    expect(codec.encode(again) == written, f"the fields {fields}, written, read and written again, are other bytes")
