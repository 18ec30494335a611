"""Compiled functions of a schema treat any bytes in the same way as the schema itself."""

from dataclasses import dataclass
from typing import ClassVar

from construct import this
from hypothesis import given
from hypothesis.strategies import integers, lists, sampled_from, tuples

from drivecomm.protocol.schema import (
    CheckCharacters,
    Form,
    characters,
    choice,
    constant,
    decimal_number,
    decimal_sum,
    hex_number,
    hex_sum,
)
from drivecomm.testing.checks.schemas import same_both_ways


@dataclass(frozen=True, kw_only=True)
class Note:
    kind: ClassVar[str] = "note"
    value: object = None
    other: object = None


FIXED = Form(
    Note,
    constant(b"<"),
    "value" / hex_number(2),
    constant(b";"),
    CheckCharacters(2, 1, hex_sum, off=b"??"),
    constant(b">"),
)
OF_ANY_SIZE = Form(
    Note,
    constant(b"<"),
    "other" / choice({b"A": "on", b"B": "off"}),
    constant(b":"),
    "length" / decimal_number(1, range(1, 6)),
    "value" / characters(this.length - 1),
    constant(b";"),
    CheckCharacters(2, 1, decimal_sum),
    constant(b">"),
    writes={"length": lambda note: len(note.value) + 1},
)


@given(
    which=sampled_from([(FIXED, Note(value=0x1F)), (OF_ANY_SIZE, Note(other="on", value="abc"))]),
    wrong=lists(tuples(integers(0, 20), sampled_from(b"<>:;?1F0aB\x80")), max_size=3),
    kept=sampled_from([*[100] * 5, *range(14)]),
    behind=sampled_from([*[b""] * 5, b">", b"12345"]),
)
def test_compiled_schema_agrees_with_the_interpreted_one(which, wrong, kept, behind):
    schema, note = which
    data = bytearray(schema.build(note))
    for place, byte in wrong:
        if place < len(data):
            data[place] = byte
    same_both_ways("note", schema, bytes(data[:kept]) + behind)
