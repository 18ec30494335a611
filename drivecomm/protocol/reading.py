"""Readings, which are values read from a drive, and the conversion between raw and physical values."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from drivecomm.errors import UsageError, ValueRefusedError, shortened
from drivecomm.protocol.frozen_factory import frozen_factory

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.protocol.model import ParameterInfo

Value: TypeAlias = int | Decimal | str
"""A value that a parameter can hold: a whole number, an exact decimal, or text."""

Quality: TypeAlias = Literal["good", "uncertain"]
"""How good a reading is. good: the drive sent this value. uncertain: `Reading.doubt` gives a reason against it.

How certain the model is of type, scale and unit is a separate fact, in `Reading.note`.
"""

# Names of model units in pint; all other units have the same name there.
_PINT_UNITS = {"%": "percent", "deg C": "degC", "1/min": "rpm", "": "dimensionless", "Nm": "N*m"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One value of one parameter.

    parameter: its address, in the protocol's form. value: the physical value if type and scale are known, otherwise the
    certain part (the characters or the unsigned number). raw: the value as the telegram carried it. unit: unit of
    value, empty if it has none or it is unknown. type: in the words of the protocol's manual, empty if unknown. name:
    the common name that was requested, or the model's name, empty without one. text: the meaning of the value, such as
    the name of an option or a fault. note: how certain type, scale and unit are, if no document prints them; this does
    not affect the quality of the value. doubt: the reason against the value, empty for a good one. time_s: when the
    reply had arrived, in seconds since 1970 (on a virtual line: since its start).
    """

    parameter: str
    value: Value
    raw: int | str
    unit: str = ""
    type: str = ""
    name: str = ""
    text: str = ""
    note: str = ""
    doubt: str = ""
    time_s: float = 0.0

    @property
    def quality(self) -> Quality:
        """Quality of the value, decided only here, both for display and for storage."""
        return "uncertain" if self.doubt else "good"

    @property
    def remark(self) -> str:
        """The doubt and the note as one text."""
        return f"{self.doubt}; {self.note}" if self.doubt and self.note else self.doubt or self.note

    @property
    def time(self) -> datetime:
        """Arrival time of the reply, in UTC; meaningless on a virtual line, whose clock starts at 0."""
        return datetime.fromtimestamp(self.time_s, UTC)

    def to_pint(self, registry: Any = None) -> Any:
        """Return the value as a quantity of pint, in this registry or in the application's registry.

        Raises UsageError if pint is not installed, if the value is a text, or if its unit is not a physical unit.
        """
        try:
            import pint
        except ImportError:
            raise UsageError("pint is not installed; install it with: pip install drivecomm[pint]") from None
        if isinstance(self.value, str):
            raise UsageError(f"{self.parameter} is the text {self.value!r}; only numbers have a unit")
        registry = registry or pint.application_registry
        try:
            unit = registry.Unit(_PINT_UNITS.get(self.unit, self.unit))
        except (pint.errors.UndefinedUnitError, pint.errors.DefinitionSyntaxError) as error:
            raise UsageError(f"{self.parameter} is in {self.unit!r}, which is not a physical unit: {error}") from error
        return registry.Quantity(self.value, unit)

    def at(self, time_s: float) -> Reading:
        """Set the time of the reply and return this reading. Only for the bus, before it hands the reading out."""
        _set_time_s(self, time_s)
        return self

    def doubted(self, why: str) -> Reading:
        """Add a reason why the value may not be this drive's, and return this reading. Only for the bus, like `at`."""
        _set_doubt(self, f"{self.doubt}; {why}" if self.doubt else why)
        return self

    def __str__(self) -> str:
        shown = f"{self.value} {self.unit}".rstrip()
        return f"{shown} ({self.text})" if self.text else shown


_set_time_s = vars(Reading)["time_s"].__set__
_set_doubt = vars(Reading)["doubt"].__set__

new_reading = frozen_factory(Reading)
"""Return a Reading, like its constructor and faster; one is made for every value that is read."""

_LARGEST, _SMALLEST = 38, -54
"""Powers of ten within which 32-bit floats keep all their digits; numbers beyond only take time to compute."""
_LARGEST_REFERENCE = 200
"""Highest option `reference_limit`, in per cent."""


def exact(value: Value | float, parameter: str) -> Decimal:
    """Return the decimal number that a caller means: the float 10.1 becomes exactly ten and one tenth.

    Raises ValueRefusedError for text that is not a number, for infinities, and for numbers that no drive can hold.
    """
    # Decimal also accepts lists, of sign, digits and exponent.
    if isinstance(value, list | tuple) or (isinstance(value, str) and not is_plain(value)):
        raise ValueRefusedError(f"{shortened(value)} for parameter {parameter} is not a number")
    try:
        number = Decimal(str(value)) if isinstance(value, float) else Decimal(value)
    except (InvalidOperation, TypeError, ValueError) as error:
        raise ValueRefusedError(f"{shortened(value)} for parameter {parameter} is not a number") from error
    if not number.is_finite() or isinstance(value, bool):
        raise ValueRefusedError(f"{shortened(value)} for parameter {parameter} is not a number")
    if number.adjusted() > _LARGEST or number.as_tuple().exponent < _SMALLEST:  # type: ignore[operator]
        raise ValueRefusedError(f"{shortened(value)} for parameter {parameter} is beyond what any drive holds")
    return number


def reference_limit_of(option: Value | float) -> Decimal:
    """Return the option `reference_limit` of a drive as a decimal. Raises UsageError unless above 0 and up to 200 %."""
    limit = exact(option, "reference_limit")
    if not 0 < limit <= _LARGEST_REFERENCE:
        raise UsageError(f"reference_limit is above 0 and up to {_LARGEST_REFERENCE} %, not {limit}")
    return limit


def is_plain(text: str) -> bool:
    """Return whether a text is ASCII without underscores; Python also reads 1_0 and digits of other scripts."""
    return text.isascii() and "_" not in text


def unscaled(physical: Decimal, factor: Decimal, parameter: str, unit: str = "") -> int:
    """Return the raw whole number for a physical value. Raises ValueRefusedError if no whole number is exact."""
    try:
        raw = physical / factor
        whole = raw == raw.to_integral_value() and raw * factor == physical
    except ArithmeticError:
        whole = False
    if not whole:
        shown = f"{factor} {unit}".rstrip()
        raise ValueRefusedError(f"{physical} for parameter {parameter} is not a multiple of {shown}; it is not rounded")
    return int(raw)


def must_know_type(type: str, types: Iterable[str], parameter: str) -> None:
    """Raise UsageError if the type of a parameter to be written is unknown."""
    if not type:
        raise UsageError(
            f"the type of parameter {parameter} is not known, so its value cannot be written; "
            f"name a model or give type= ({', '.join(types)})"
        )


def whole_number(value: Value | float, parameter: str, info: ParameterInfo | None, type: str, allowed: range) -> int:
    """Return the whole number that carries a value; the value is physical if a model knows the scale.

    Without a scale, the value is the number itself. allowed: the numbers that this type can hold. Raises
    ValueRefusedError for a value outside the limits of the parameter, between two steps, or beyond the type.
    """
    number = exact(value, parameter)
    if info is not None:
        info.check(number)
    factor, unit = (info.factor, info.unit) if info else (Decimal(1), "")
    raw = unscaled(number, factor, parameter, unit)
    must_fit(raw, allowed, f"{value} for parameter {parameter}", factor, unit=unit, type=type)
    return raw


def must_fit(raw: int, allowed: range, what: str, factor: Decimal, *, unit: str, type: str) -> None:
    """Raise ValueRefusedError for a whole number that its type cannot hold.

    what: the value and its parameter, for the message. factor, unit: factor and unit of the value.
    """
    if raw not in allowed:
        end, where, which = (allowed[0], "below", "lowest") if raw < allowed[0] else (allowed[-1], "above", "highest")
        limit = f"{end * factor} {unit}".rstrip()
        raise ValueRefusedError(f"{what} is {where} {limit}, the {which} value that {type} holds")


def scaled(raw: int, factor: Decimal) -> int | Decimal:
    """Return the physical value of a raw value; with a factor of 1 it stays a whole number."""
    return raw if factor == 1 else raw * factor
