"""Field names in vectors, where the manual uses the name of the drive's address for another field."""

from dataclasses import dataclass, field
from typing import ClassVar

import pytest

from drivecomm.errors import TelegramError
from drivecomm.protocol import fields_of
from drivecomm.protocol.schema import Form, Telegrams, constant, hex_number


@dataclass(frozen=True, slots=True, kw_only=True)
class Read:
    """A request for a register, which the manual of the drive calls the address."""

    kind: ClassVar[str] = "read"
    address: int = field(metadata={"shown": "station"})
    first: int = field(metadata={"shown": "address"})


class Told(Read):
    """The reply of the drive."""


LEAVES = "address" / hex_number(2, "station"), "first" / hex_number(4, "address")
CODEC = Telegrams({"Read": Form(Read, constant(b"\x05"), *LEAVES)}, {"Told": Form(Told, constant(b"\x06"), *LEAVES)})


def test_fields_of_a_message_have_the_names_of_the_vectors():
    message = CODEC.decode(b"\x051A0005", "request")
    assert message.address == 0x1A
    assert fields_of(message) == {"kind": "read", "station": 0x1A, "address": 5}


def test_message_is_built_from_fields_named_as_in_vectors():
    assert CODEC.message({"station": 0x1A, "address": 5}, "request") == Read(address=0x1A, first=5)


@pytest.mark.parametrize("given", [{"address": 5}, {"station": 1, "address": 5, "first": 5}])
def test_refusal_names_fields_as_in_vectors(given):
    with pytest.raises(TelegramError, match=r"station|'first'"):
        CODEC.message(given, "request")
