"""Parameter addresses such as `516`, `502[17]`, `602[13,5]` and `bus_reference`, values, and causes of refusals.

Values are exact (VLT Series 3500 manual, printed page 86, bytes 13 to 19): sign, five digits and the position of the
point, so an integer and a power of ten. They are never converted to binary floating point.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError, UsageError, ValueRefusedError
from drivecomm.protocol import AddressSpace, Elements, Value, exact, new_reading, tables_beside

if TYPE_CHECKING:
    from drivecomm.protocol import Model, ParameterInfo, Reading
    from drivecomm_vlt3500.options import VltOptions

DIGITS = 5
DECIMALS = range(6)

# Causes of a refusal, in bytes 17 and 18 of a reply whose byte 19 is 9; tables.toml has their meaning.
UNKNOWN_PARAMETER, NOT_ACCESSIBLE, NO_SUCH_INDEX, NOT_INDEXED, READ_ONLY = range(5)
NOT_WHILE_RUNNING, OUT_OF_RANGE, BAD_DECIMALS, TOO_LONG_TO_SEND, ANYTHING_ELSE = 5, 6, 7, 8, 99

_ADDRESS = re.compile(r"(\d{1,4})(?:\[\s*(\d{1,5})\s*(?:,\s*(\d{1,2})\s*)?\])?", re.ASCII)
_INDEX = re.compile(r"\s*(\d{1,5})\s*(?:,\s*(\d{1,2})\s*)?", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class VltTarget:
    """A parameter, or one element of an indexed one, with its model data."""

    number: int
    index: tuple[int, ...] | None
    info: ParameterInfo | None

    @cached_property
    def address(self) -> str:
        """The parameter address in its simplest form: `516`, `502[17]`, `602[13,5]`."""
        return written(self.number, self.index)

    @cached_property
    def doubt(self) -> str:
        """Uncertain facts about its values, as a note."""
        if self.info is None:
            return "unit not known"
        return self.info.note


def written(number: int, index: tuple[int, ...] | None) -> str:
    """Return the parameter address for a number and an index, with three digits or more as in the manuals."""
    return f"{number:03d}" + (f"[{','.join(map(str, index))}]" if index is not None else "")


def target(parameter: str, model: Model | None, index: Any = None) -> VltTarget:
    """Return the target of a parameter address or of a name in the model.

    Numbers run from 0 to 9999; leading zeros are ignored. An index is in brackets, [n] or [x,y], or a separate
    argument: a number, a pair, or text such as "13,5". y counts in ones: [13,5] is 013.05 in the telegram. Raises
    ParameterAddressError for anything else, UsageError for two different indices.
    """
    name = parameter.partition("[")[0]
    exactly = model.find(parameter) if model else None
    known = exactly or (model.find(name) if model else None)
    if known is None:
        text = parameter
    else:
        text = known.address if exactly else known.address.partition("[")[0] + parameter[len(name) :]
    match = _ADDRESS.fullmatch(text)
    if match is None:
        remedy = f"nor a name of model {model.name}" if model else "such as 516, 502[17] or 602[13,5]"
        raise ParameterAddressError(f"{parameter!r} is not a VLT parameter address {remedy}")
    number = int(match[1])
    found = _pair(match[2], match[3])
    given = _index(index)
    if found is not None and given is not None and found != given:
        raise UsageError(f"{parameter} names an index, and index={index!r} another")
    chosen = found if found is not None else given
    return VltTarget(number=number, index=chosen, info=_info(model, number, chosen) or known)


def element_addresses(info: ParameterInfo, _options: VltOptions) -> tuple[str, ...]:
    """Return the addresses of a parameter's values.

    For an indexed parameter with two dimensions these are all elements; elements of one with one dimension are
    parameters of the model.
    """
    sizes = info.extra.get("indexed")
    if sizes is None:
        return (info.address,)
    if len(sizes) < 2:
        return ()
    return tuple(written(int(info.address), index) for index in product(*map(range, sizes)))


def _info(model: Model | None, number: int, index: tuple[int, ...] | None) -> ParameterInfo | None:
    """Return the model data of the element, or else of the parameter; own models may write leading zeros or none."""
    if model is None:
        return None
    element = written(number, index).partition("[")[2]
    tails = [f"[{element}", ""] if element else [""]
    tries = (f"{number:0{width}d}{tail}" for tail in tails for width in (3, 4, 1))
    return next((info for info in map(model.find, tries) if info is not None), None)


def _index(index: Any) -> tuple[int, ...] | None:
    if index is None:
        return None
    text = (
        index if isinstance(index, str) else ",".join(map(str, index if isinstance(index, list | tuple) else [index]))
    )
    match = _INDEX.fullmatch(text)
    if match is None:
        raise ParameterAddressError(f"index {index!r} is neither n nor x,y")
    return _pair(match[1], match[2])


def _pair(x: str | None, y: str | None) -> tuple[int, ...] | None:
    if x is None:
        return None
    if y is None:
        return (int(x),)
    if int(x) > 999:
        raise ParameterAddressError(f"index {x},{y}: x is 0 to 999, and y is 0 to 99")
    return (int(x), int(y))


def reading_of(wanted: VltTarget, value: Decimal, note: str = "") -> Reading:
    """Return the reading for a reply's value: the number is certain, its unit is known only with a model."""
    info, raw = wanted.info, str(value)
    physical = value if info is None or info.factor == 1 else value * info.factor
    texts = info.values if info else {}
    return new_reading(
        parameter=wanted.address,
        name=info.name if info else "",
        value=_shown(physical, raw if physical is value else str(physical)),
        raw=raw,
        unit=info.unit if info else "",
        type=info.type if info else "",
        text=texts.get(int(value), "") if texts and value == value.to_integral_value() else "",
        note="; ".join(filter(None, (note, wanted.doubt))),
    )


def _shown(number: Decimal, text: str) -> Decimal | int:
    """Return a number for display: an int if it has no decimals."""
    return int(text) if text.lstrip("-").isdigit() else number


def data_for(wanted: VltTarget, value: Value | float, decimals: int | None) -> tuple[Decimal, int]:
    """Return the value as it is sent, and byte 19.

    decimals: None for the model's `decimals`, or the fewest that are exact. Limits are checked if the model has them
    from a manual; for limits that only the drive knows, it answers cause 06. Raises ValueRefusedError.
    """
    info = wanted.info
    number = exact(value, wanted.address)
    if info is not None and info.extra.get("limits") != "assumed":
        info.check(number)
    sent = number
    if info is not None and info.factor != 1:
        sent = number / info.factor
        if sent * info.factor != number:
            raise ValueRefusedError(f"{value} for parameter {wanted.address} is not a multiple of {info.factor}")
    if decimals is None and info is not None:
        decimals = info.extra.get("decimals")
    try:
        digits, places = packed(sent, decimals)
    except ValueError as error:
        raise ValueRefusedError(f"parameter {wanted.address}: {error}") from error
    sign = int(sent < 0)
    return Decimal((sign, tuple(map(int, str(digits))), -places)), places


def address_space(_options: VltOptions, _model: Model | None) -> AddressSpace:
    """Return the addresses that a drive can hold; neither options nor model restrict them.

    The telegram has room for four digits; every number that the manuals print has three.
    """
    return AddressSpace(
        addresses=lambda: (f"{number:03d}" for number in range(1000)),
        absent=frozenset({UNKNOWN_PARAMETER, NO_SUCH_INDEX, NOT_INDEXED}),
        source="numbers of three digits: VLT Series 3500 manual, printed pages 87 to 92; causes: printed page 92",
        elements=_indices,
    )


def _indices(address: str, code: int | None) -> Elements:
    """Return the indices to try for a parameter that is refused without an index.

    The table of causes has this refusal, but no manual prints it as the answer to R. No printed index has more than two
    digits, and the fault memory has about ten rows. A run without a first element costs one request. No manual prints
    whether an index begins at 0 or 1.
    """
    if code != NO_SUCH_INDEX:
        return Elements()
    flat = tuple(tuple(f"{address}[{x}]" for x in range(first, 100)) for first in (0, 1))
    pairs = tuple(tuple(f"{address}[{x},{y}]" for y in range(100)) for x in range(20))
    return Elements(runs=flat + pairs)


def cause_text(code: int) -> str:
    """Return the manual's meaning of a cause; a cause that is not listed is named by its number."""
    return str(tables_beside(__file__, "tables.toml")["causes"].get(str(code), f"unlisted cause {code}"))


def number(value: Any) -> Decimal:
    """Return the number in a field: Decimal, whole number or text. Raises ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, Decimal | int | str):
        raise ValueError(f"{value!r} is not an exact number")  # noqa: TRY004 - the same error for every invalid number
    try:
        exact = Decimal(value)
    except InvalidOperation:
        raise ValueError(f"{value!r} is not a number") from None
    if not exact.is_finite():
        raise ValueError(f"{value!r} is not a finite number")
    return exact


def packed(value: Decimal, decimals: int | None) -> tuple[int, int]:
    """Return the five digits as a number, and byte 19.

    decimals: number of digits after the point; None for the fewest that are exact. Raises ValueError if the value is
    not exact with this many decimals or has more than five digits: nothing is rounded.
    """
    _, digits, exponent = value.as_tuple()
    power = int(exponent)
    text = "".join(map(str, digits)).lstrip("0")
    significant = text.rstrip("0")
    power += len(text) - len(significant)
    fewest = max(0, -power) if significant else 0
    chosen = fewest if decimals is None else decimals
    if type(chosen) is not int or chosen not in DECIMALS:
        raise ValueError(f"{value} with {chosen!r} decimals; a telegram has 0 to 5")
    if not significant:
        return 0, chosen
    if fewest > chosen:
        raise ValueError(f"{value} is not exact with {chosen} decimals, and it is not rounded")
    if len(significant) + power + chosen > DIGITS:
        raise ValueError(f"{value} with {chosen} decimals has more than {DIGITS} digits")
    return int(significant) * 10 ** (power + chosen), chosen


def unpacked(*, negative: bool, digits: str, decimals: int) -> Decimal:
    """Return the number in bytes 13 to 19, with the number of decimals in byte 19; minus zero is zero.

    Raises ValueError if the characters are not digits; spaces are refused, because no printed telegram has them.
    """
    if not (digits.isascii() and digits.isdigit()):
        raise ValueError(f"{digits!r} are not {DIGITS} decimal digits")
    # A Decimal made from text is exact, whatever precision the program has set.
    found = Decimal(f"{digits}E-{decimals}")
    return found.copy_negate() if negative and found else found
