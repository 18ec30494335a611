"""What must hold for every telegram of a protocol, tried with hypothesis on telegrams that no document prints.

The same examples are drawn every time. Needs hypothesis, the extra `test` of drivecomm.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hypothesis import HealthCheck, Phase, given, settings, strategies as st

from drivecomm.errors import DriveCommError, TelegramError
from drivecomm.protocol import Framed, Framer, Noise, fields_of
from drivecomm.testing import strategies
from drivecomm.testing.checking import CheckFailure, check, expect, known_model, shown
from drivecomm.testing.checks.schemas import same_both_ways
from drivecomm.testing.checks.telegrams import finds, frames

if TYPE_CHECKING:
    from collections.abc import Callable

    from hypothesis.strategies import DataObject, SearchStrategy

    from drivecomm.protocol import Direction, Protocol


class Drawn:
    """Where the examples of one protocol come from, for telegrams of one direction.

    Asking the encoder for the limits of every field takes longer than drawing from them, so this is made once. Raises
    FileFormatError for a package without vectors.
    """

    def __init__(self, plugin: Protocol, direction: Direction) -> None:
        self.plugin = plugin
        self.direction = direction
        self.codec = plugin.codec(plugin.options())
        self.model = known_model(plugin, plugin.default_model)
        self.fields = strategies.telegram_fields(plugin, direction)
        self.telegrams = strategies.telegrams(plugin, direction)
        self.junk_fields: SearchStrategy[dict[str, Any]] = strategies.junk_fields(plugin, direction)
        self.near = strategies.near_telegrams(plugin, direction)
        self.noise = strategies.line_noise(self.codec, direction)


def try_examples(holds: Callable[[Drawn, DataObject], None], source: Drawn, examples: int) -> None:
    """Try a property on so many examples; the smallest one that breaks it is what is reported."""

    @settings(
        max_examples=examples,
        derandomize=True,
        deadline=None,
        database=None,
        phases=(Phase.explicit, Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
        report_multiple_bugs=False,
        print_blob=False,
    )
    @given(data=st.data())
    def attempt(data: DataObject) -> None:
        holds(source, data)

    attempt()


@check("properties")
def decodes_what_it_encodes(source: Drawn, data: DataObject) -> None:
    """What is encoded decodes to the same, and what is decoded encodes to the same."""
    plugin, codec, direction = source.plugin, source.codec, source.direction
    fields = data.draw(source.fields)
    message = plugin.message(fields, direction)
    written = codec.encode(message)
    read = codec.decode(written, direction)
    expect(read == message, f"{message} is {shown(written)}, and that is {read}")
    expect(codec.encode(read) == written, f"{shown(written)} is {read}, and that is {shown(codec.encode(read))}")
    again = codec.encode(plugin.message(fields_of(read), direction))
    expect(again == written, f"the fields {fields_of(read)} of {shown(written)} make {shown(again)}")


@check("properties")
def decodes_or_refuses(source: Drawn, data: DataObject) -> None:
    """Any bytes are decoded to something that has a kind and fields, or refused with a TelegramError."""
    received = data.draw(source.near)
    try:
        message = source.codec.decode(received, source.direction)
    except TelegramError:
        return
    except Exception as error:
        raise CheckFailure(f"{shown(received)} raises {error!r}") from error
    expect(fields_of(message)["kind"] == message.kind, f"{shown(received)} has the fields {fields_of(message)}")


@check("properties")
def encodes_or_refuses(source: Drawn, data: DataObject) -> None:
    """Any fields make a sound telegram, or are refused with an error of the tree."""
    fields = data.draw(source.junk_fields)
    try:
        written = source.codec.encode(source.plugin.message(fields, source.direction))
    except DriveCommError:
        return
    except Exception as error:
        raise CheckFailure(f"the fields {fields} raise {error!r}") from error
    try:
        source.codec.decode(written, source.direction)
    except TelegramError as error:
        raise CheckFailure(f"the fields {fields} make {shown(written)}, which is refused: {error}") from error


@check("properties")
def finds_the_same_in_any_pieces(source: Drawn, data: DataObject) -> None:
    """However a stream is cut, the same telegrams are found in it."""
    codec, direction = source.codec, source.direction
    parts = st.one_of(source.telegrams, source.noise, source.near)
    stream = b"".join(data.draw(st.lists(parts, max_size=5)))
    whole = frames(codec, direction, [stream])
    pieces = data.draw(strategies.pieces(stream))
    expect(frames(codec, direction, pieces) == whole, f"{shown(stream)} in the pieces {pieces}")
    single = frames(codec, direction, [stream[place : place + 1] for place in range(len(stream))])
    expect(single == whole, f"{shown(stream)} byte by byte")


@check("properties")
def finds_every_telegram_between_noise(source: Drawn, data: DataObject) -> None:
    """Between characters that begin no telegram, and after a gap, every telegram is found."""
    framer = Framer(source.codec, source.direction)
    sent, found = [], []
    for telegram in data.draw(st.lists(source.telegrams, min_size=1, max_size=4)):
        noise = data.draw(source.noise)
        finds_here = [*framer.feed(noise), *framer.flush(), *framer.feed(telegram), *framer.flush()]
        sent.append(telegram)
        found += [find.data for find in finds_here if isinstance(find, Framed)]
    expect(found == sent, f"sent {[shown(each) for each in sent]}, found {[shown(each) for each in found]}")


@check("properties")
def loses_and_invents_no_byte(source: Drawn, data: DataObject) -> None:
    """Each byte that comes is part of a telegram, or noise."""
    received = data.draw(source.near)
    found = finds(source.codec, source.direction, [received])
    # What is damaged is looked at again, so its bytes are counted as noise or as part of a telegram.
    seen = sum(len(find.data) for find in found if isinstance(find, Framed | Noise))
    expect(seen == len(received), f"of the {len(received)} bytes {shown(received)} {seen} are accounted for")


@check("properties")
def measures_rising(source: Drawn, data: DataObject) -> None:
    """The length that a telegram needs never becomes less while it comes, and is never less than what is there."""
    codec, direction = source.codec, source.direction
    telegram = data.draw(source.telegrams)
    known = 1
    for length in range(1, len(telegram)):
        needed = codec.measure(telegram[:length], direction)
        enough = needed == length == 1 or needed > length
        expect(enough and needed >= known, f"the first {length} bytes of {shown(telegram)} are measured as {needed}")
        known = needed
    measured = codec.measure(telegram, direction)
    expect(measured >= len(telegram), f"{shown(telegram)} is measured as {measured}")


@check("properties")
def compiled_is_interpreted(source: Drawn, data: DataObject) -> None:
    """Compiled and interpreted schemas read and write alike."""
    received = data.draw(source.near)
    for title, form in source.plugin.forms().items():
        same_both_ways(title, form, received)


@check("properties")
def survives_whatever_it_hears(source: Drawn, data: DataObject) -> None:
    """A virtual drive raises nothing, whatever comes, and what it answers is a sound reply."""
    plugin = source.plugin
    drive = plugin.virtual(plugin.addresses[0], plugin.options(), source.model)
    for number, piece in enumerate(data.draw(st.lists(source.near, max_size=4)), 1):
        for find in finds(drive.codec, "request", [piece]):
            answer = None if isinstance(find, Noise) else drive.hear(find, float(number))
            if answer is not None:
                drive.codec.decode(answer.data, "reply")
                expect(answer.delay_s >= 0, f"it answers {shown(piece)} before it was asked")
