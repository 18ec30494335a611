"""Checks of schemas: the compiled functions do the same as the declared schemas."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, TelegramError
from drivecomm.testing.checking import check, expect, message_hex

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivecomm.protocol import Message
    from drivecomm.protocol.schema import Form
    from drivecomm.testing.checking import VectorCase


@check("schemas", "linked")
def compiles_whole(form: Form[Any]) -> None:
    """The schema is read and written by compiled functions, not leaf by leaf."""
    interpreted = form.parse_compiled == form.parse_declared or form.build_compiled == form.build_declared
    expect(not interpreted, "a leaf cannot be compiled, so the whole schema is interpreted")


@check("vectors", "compiled", costly=True)
def compiled_as_interpreted(case: VectorCase) -> None:
    """Every form reads and writes the telegram and damaged copies alike, compiled and interpreted."""
    data = case.vector.data
    message = case.codec.decode(data, case.vector.direction) if case.vector.valid else None
    for title, form in case.plugin.forms().items():
        for each in (data, data[:-1], data + b"0", *_changed_at(len(data) // 2, data)):
            same_both_ways(title, form, each)
        # Only the matching form reads past the first wrong constant, so only it is tried with every byte.
        if _outcome(form.parse_compiled, data) is not None:
            for place in range(len(data)):
                for each in _changed_at(place, data):
                    same_both_ways(title, form, each)
        if message is not None:
            _same_writing(title, form, message)


def same_both_ways(title: str, form: Form[Any], data: bytes) -> None:
    """The compiled and the interpreted schema give the same message for these bytes, or both refuse them alike.

    The message is then written in both ways as well.
    """
    fast, declared = _outcome(form.parse_compiled, data), _outcome(form.parse_declared, data)
    found, judged = _refusal(form.parse, data), _refusal(form.parse_declared, data)
    expect(
        found == judged, f"{title} refuses {message_hex(data)} with {found!r} compiled and with {judged!r} interpreted"
    )
    expect(
        type(fast) is type(declared) and fast == declared,
        f"{title} reads {message_hex(data)} as {fast} compiled and as {declared} interpreted",
    )
    if fast is not None:
        _same_writing(title, form, fast)


def _same_writing(title: str, form: Form[Any], message: Message) -> None:
    """Check that both schemas, compiled and interpreted, write this message alike; skip messages of other types."""
    if type(message) is not form.message:
        return
    fast, declared = _outcome(form.build_compiled, message), _outcome(form.build_declared, message)
    expect(fast == declared, f"{title} writes {message} as {fast!r} compiled and as {declared!r} interpreted")


def _changed_at(place: int, data: bytes) -> Iterator[bytes]:
    """Yield the telegram with several wrong values in the byte at this index."""
    for wrong in (data[place] ^ 1, data[place] ^ 0x80, 0x20, 0x61):
        yield data[:place] + bytes([wrong]) + data[place + 1 :]


def _refusal(parse: Callable[[bytes], Any], data: bytes) -> tuple[str, ...]:
    """Return the category, field and text with which a form refuses these bytes; () if it accepts them."""
    try:
        parse(data)
    except TelegramError as error:
        return error.category, error.field, str(error)
    except Exception as error:  # noqa: BLE001 - a form gets bytes here that its codec would never pass on
        return (type(error).__name__,)
    return ()


def _outcome(function: Callable[[Any], Any], given: Any) -> Any:
    """Return the result of a function, or None if it refuses its argument."""
    try:
        return function(given)
    except DriveCommError as error:
        expect(isinstance(error, TelegramError), f"refused by {type(error).__name__}, not by a TelegramError")
        return None
    except Exception:  # noqa: BLE001 - compiled code may refuse with any exception
        return None
