"""Parameter addresses, such as `16-14`, `3-10[3]`, `520` and `motor_current`, and the values of parameters.

Specification, sections 8, 10 and 11.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError, UsageError, ValueRefusedError
from drivecomm.protocol import AddressSpace, Elements, Value, must_know_type, new_reading, scaled, whole_number
from drivecomm_danfoss_fc.tables import NO_SUCH_INDEX, NO_SUCH_PARAMETER, NOT_AN_ARRAY

if TYPE_CHECKING:
    from drivecomm.protocol import Model, ParameterInfo, Reading
    from drivecomm_danfoss_fc.messages import ParameterReply
    from drivecomm_danfoss_fc.options import DanfossFcOptions

TYPES = ("int16", "int32", "uint8", "uint16", "uint32", "text")
DATA_TYPES = {"int16": 3, "int32": 4, "uint8": 5, "uint16": 6, "uint32": 7, "text": 9}
"""Numbers of the data types (VLT 5000 Design Guide p. 87; FC 102 guide); others are named in the models."""

# N2 (4000 hex is 100 %) and V2 (a sequence of bits) take 16 bits on the line.
TYPES_BY_NUMBER = {number: name for name, number in DATA_TYPES.items()} | {33: "int16", 35: "uint16"}

RANGES = {
    "int16": range(-(2**15), 2**15),
    "int32": range(-(2**31), 2**31),
    "uint8": range(2**8),
    "uint16": range(2**16),
    "uint32": range(2**32),
}

_ADDRESS = re.compile(
    r"(?:(?P<group>\d{1,2})-(?P<member>\d{2})|(?P<number>\d{1,4}))(?:\[(?P<index>\d{1,3})\])?", re.ASCII
)


@dataclass(frozen=True, kw_only=True)
class Target:
    """A parameter with the known facts about it.

    index: None if the parameter is not an array and was named without an index.
    """

    pnu: int
    name: str
    index: int | None
    type: str
    info: ParameterInfo | None

    @cached_property
    def address(self) -> str:
        """Parameter address as the maker writes it."""
        return self.name if self.index is None else f"{self.name}[{self.index}]"

    @property
    def ind(self) -> int:
        """IND word of a number: the array index in the low byte."""
        return self.index or 0

    @cached_property
    def is_number(self) -> bool:
        """Whether the type is known and is a number."""
        return self.type in RANGES

    @cached_property
    def scale(self) -> ParameterInfo | None:
        """Facts that give the scale of its numbers; None if there are none."""
        return self.info if self.is_number and self.info and self.info.type != "text" else None

    @cached_property
    def doubt(self) -> str:
        """Remark on the uncertainty of its numbers; empty if there is none."""
        if not self.is_number:
            return "type not known: this is the unsigned number as sent"
        if self.scale is None:
            return "scale not known: this is the number as sent"
        return self.scale.note

    @cached_property
    def bits(self) -> int:
        """Number of bits that a number of its type takes on the line."""
        return bits_of(self.type)

    def reading(self, **what: Any) -> Reading:
        """Return a reading of this parameter with these fields."""
        return new_reading(parameter=self.address, name=self.info.name if self.info else "", **what)


def target(
    parameter: str, model: Model | None, options: DanfossFcOptions, *, type: str = "", index: int | None = None
) -> Target:
    """Return the parameter for an address or a name of the model.

    `16-14` is group and member, PNU 1614; `520` is the PNU itself. The array index is in brackets, as it goes into IND.
    Raises ParameterAddressError for anything else.
    """
    name, opening, rest = parameter.partition("[")
    known = model.find(name) if model else None
    match = _ADDRESS.fullmatch((known.address if known else name) + opening + rest)
    if match is None:
        remedy = f"nor a name of model {model.name}" if model else "such as 16-14, 3-10[3] or 520"
        raise ParameterAddressError(f"{parameter!r} is not an FC parameter address {remedy}")
    pnu = int(match["number"] or match["group"] + match["member"])
    if pnu >= 2**options.pnu_bits:
        raise ParameterAddressError(
            f"parameter {parameter} cannot be reached: its number {pnu} is beyond {2**options.pnu_bits - 1}, the "
            f"highest that {options.pnu_bits} bits can name"
        )
    if known is None and model:
        # A PNU means the same parameter, however the model writes its address.
        known = next((each for each in model.parameters.values() if number_of(each.address) == pnu), None)
    if match["index"] is not None:
        if index is not None and index != int(match["index"]):
            raise UsageError(f"{parameter} names index {match['index']}, and index={index} another")
        index = int(match["index"])
    if index is None and known is not None and "elements" in known.extra:
        index = options.index_base
    if index is not None and index not in range(256):
        raise ParameterAddressError(
            f"index {index} of parameter {parameter} does not fit the low byte of IND, 0 to 255"
        )
    chosen = type or (known.type if known else "")
    if chosen not in ("", *TYPES):
        raise UsageError(f"{chosen!r} is not a type of the FC protocol; they are {', '.join(TYPES)}")
    plain = str(pnu) if match["number"] else f"{int(match['group'])}-{match['member']}"
    return Target(pnu=pnu, name=known.address if known else plain, index=index, type=chosen, info=known)


def element_addresses(info: ParameterInfo, options: DanfossFcOptions) -> tuple[str, ...]:
    """Return the addresses of a parameter's values: of each element of an array, or of its only value."""
    places = range(int(info.extra.get("elements", 0)))
    return tuple(f"{info.address}[{options.index_base + place}]" for place in places) or (info.address,)


def number_of(address: str) -> int:
    """Return the PNU of a model's address: 4-14 is 414, 001 is 1. Raises ParameterAddressError."""
    match = _ADDRESS.fullmatch(address)
    if match is None or match["index"]:
        raise ParameterAddressError(f"the model's {address!r} is not an FC parameter address such as 16-14 or 520")
    return int(match["number"] or match["group"] + match["member"])


def reading_of(wanted: Target, reply: ParameterReply) -> Reading:
    """Return the reading from the reply to a read or a write.

    AK decides the width. Of a word only PWE low counts, whatever type the model gives, because small drives keep some
    parameters in 16 bits and the FC guides print a word for 3-41 (specification, sections 6.2 and 16). A signed word is
    read as a word even from a double word, with or without the sign in the high word.
    """
    bits = 16 if reply.ak == 1 else 32
    raw = reply.pwe & 0xFFFF if bits == 16 else reply.pwe
    note = ""
    if bits != wanted.bits and wanted.is_number:
        note = f"the drive answered {wanted.type} with {'a word' if bits == 16 else 'a double word'}"
    if wanted.type == "int16" and raw <= 0xFFFF:
        # No manual says whether a drive fills the high word of a negative word with the sign.
        bits = 16
    return _physical(wanted, raw, counted(raw, wanted.type, bits), note)


def _physical(wanted: Target, raw: int, value: int, note: str) -> Reading:
    """Return the reading of a number.

    value: the number in the type of the parameter, if that is a numeric type.
    """
    scale, doubt = wanted.scale, wanted.doubt
    return wanted.reading(
        raw=raw,
        value=scaled(value, scale.factor) if scale else value,
        unit=scale.unit if scale else "",
        type=wanted.type if wanted.is_number else "",
        text=scale.values.get(value, "") if scale else "",
        note=f"{note}; {doubt}" if note and doubt else note or doubt,
    )


def limit_reading(wanted: Target, pwe: int, note: str) -> Reading:
    """Return the reading of a limit or default value (description elements 7, 8, 20), scaled like the parameter."""
    return _physical(wanted, pwe, counted(pwe, wanted.type, wanted.bits if wanted.is_number else 32), note)


def text_reading(wanted: Target, text: str, note: str = "") -> Reading:
    """Return the reading of a text; trailing spaces and zero bytes are padding (specification, section 8)."""
    return wanted.reading(value=trimmed(text), raw=text, type="text", note=note)


def trimmed(text: str) -> str:
    """Return a text without its padding."""
    return text.rstrip(" \0")


def bits_of(type: str) -> int:
    """Return the number of bits that a number of this type takes on the line, where a byte takes a word."""
    return 32 if type in ("int32", "uint32") else 16


def signed(raw: int, bits: int) -> int:
    """Return the value of an unsigned number in two's complement with this many bits."""
    return raw - 2**bits if raw >= 2 ** (bits - 1) else raw


def counted(raw: int, type: str, bits: int) -> int:
    """Return the value of a number's low bits in a type."""
    return signed(raw % 2**bits, bits) if type.startswith("int") else raw % 2**bits


def raw_for(wanted: Target, value: Value | float) -> int:
    """Return the signed number that carries a value; the value is physical if the model knows the scale.

    Raises ValueRefusedError for a value that does not fit, UsageError if the type is unknown.
    """
    must_know_type(wanted.type, TYPES, wanted.address)
    info = wanted.info if wanted.info and wanted.info.type != "text" else None
    return whole_number(value, wanted.address, info, wanted.type, RANGES[wanted.type])


def text_for(wanted: Target, value: Value | float, longest: int) -> str:
    """Return the characters to write, without padding. Raises ValueRefusedError unless it is a text that fits."""
    if not isinstance(value, str):
        raise ValueRefusedError(f"{value!r} for parameter {wanted.address} is not a text")
    if wanted.info is not None:
        longest = int(wanted.info.extra.get("characters", longest))
    if len(value) > longest:
        raise ValueRefusedError(f"{value!r} for parameter {wanted.address} is longer than {longest} characters")
    if any(ord(character) > 0xFF for character in value):
        raise ValueRefusedError(f"{value!r} for parameter {wanted.address} has characters outside ISO 8859-1")
    return value


def address_space(options: DanfossFcOptions, model: Model | None) -> AddressSpace:
    """Return the parameter addresses that a drive can hold.

    options: for the number of bits in its PNU. model: for the form of its addresses. Faults 0, 3 and 4 are in the
    tables of all manuals.
    """
    grouped = model is None or any("-" in address for address in model.parameters)
    numbers = range(1, 2**options.pnu_bits) if options.pnu_bits > 11 else range(1, 991)
    return AddressSpace(
        addresses=lambda: (f"{each // 100}-{each % 100:02d}" if grouped else f"{each:03d}" for each in numbers),
        absent=frozenset({NO_SUCH_PARAMETER, NO_SUCH_INDEX, NOT_AN_ARRAY}),
        source=(
            "PNU of 11 bits, 1 to 990: VLT 6000 manual p. 124, VLT 5000 PROFIBUS manual p. 24; of 12 bits: FC 101 "
            "Design Guide MG18C822, 7.4.8; index: the same, 7.4.9, and VLT 5000 Crane manual p. 98"
        ),
        elements=_indices,
    )


def _indices(address: str, code: int | None) -> Elements:
    """Return the elements of an array to read after its plain address.

    The plain address means element 0, which an array that counts from 1 does not have. No array of the manuals has an
    element 255: a drive that answers it ignores the index.
    """
    if code not in (None, NO_SUCH_INDEX):
        return Elements()
    return Elements(runs=(tuple(f"{address}[{index}]" for index in range(1, 255)),), beyond=f"{address}[255]")
