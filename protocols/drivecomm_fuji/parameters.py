"""Parameter addresses, such as `S05`, `F07` and `acceleration_time_1`, and the values of parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivecomm.errors import ParameterAddressError, UnexpectedReplyError, ValueRefusedError
from drivecomm.protocol import AddressSpace, Value, exact, new_reading
from drivecomm_fuji.generations import FUNCTION_ERROR, FUNCTIONS
from drivecomm_fuji.words import COMMAND, FREQUENCY, FREQUENCY_PU, FULL_SCALE, RUN, Format, format_of, word_text

if TYPE_CHECKING:
    from decimal import Decimal

    from drivecomm.protocol import Model, ParameterInfo, Reading
    from drivecomm_fuji.options import FujiOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A function code, with the known facts about its value."""

    function: str
    format: Format
    info: ParameterInfo | None


def target(parameter: str, model: Model | None, options: FujiOptions, format: str | int | None = None) -> Target:
    """Return the function for a parameter address or a name of the model.

    An address is a type letter, whose case matters, and two digits. format: the data format in the manual's numbering,
    instead of the model's. Raises ParameterAddressError for an address that the drive's generation does not have,
    UsageError for a format that no table lists.
    """
    known = model.find(parameter) if model else None
    function = known.address if known else parameter
    if function not in FUNCTIONS:
        remedy = f"nor a name of model {model.name}" if model else "such as S05, M09 or F03"
        raise ParameterAddressError(f"{parameter!r} is not a Fuji function code {remedy}")
    reason = options.generation.refusal_of(function, number_check=options.number_check)
    if reason:
        raise ParameterAddressError(f"{function}: {reason}", says="number_check=False")
    name = format if format is not None else (known.type if known else "")
    return Target(function=function, format=format_of(function, name, options), info=known)


def reading_of(
    wanted: Target, data: int, options: FujiOptions, model: Model | None, *, negative: bool = False, note: str = ""
) -> Reading:
    """Return the reading from the data of a reply. Raises UnexpectedReplyError if its format has no such value.

    raw is the number of the four digits, negative if the sign character is before them.
    """
    info, form = wanted.info, wanted.format
    raw = -data if negative else data
    name = info.name if info else ""
    if not form.name or not form.known:
        what = f"format {form.name} not known ({form.meaning})" if form.name else "format not known"
        plain = f"{what}: this is the plain number" + (f"; {note}" if note else "")
        return new_reading(parameter=wanted.function, name=name, raw=raw, type=form.name, value=raw, note=plain)
    try:
        value = form.value(data, negative=negative)
    except ValueError as error:
        raise UnexpectedReplyError(
            f"parameter {wanted.function} has no value of format {form.name}: {error}"
        ) from error
    faults = model.faults if model else {}
    text = word_text(form.name, data, options.generation, faults)
    return new_reading(
        parameter=wanted.function,
        name=name,
        raw=raw,
        type=form.name,
        value=value,
        unit=info.unit if info else "",
        text=(info.values.get(raw, "") if info else "") or text,
        note="; ".join(filter(None, (info.note if info else "", note))),
    )


def word_for(wanted: Target, value: Value | float, options: FujiOptions) -> int:
    """Return the data word that carries a value: physical if the format is known, otherwise the plain number.

    Raises ValueRefusedError for a value that does not fit.
    """
    function, form, info = wanted.function, wanted.format, wanted.info
    number = exact(value, function)
    if info is not None:
        info.check(number)
    unit = info.unit if info else ""
    if form.name and not form.known:
        raise ValueRefusedError(
            f"{number} for parameter {function}: format {form.name} is not known ({form.meaning}); "
            + ("give the inverter's rating_hp" if form.name == "[19]" else "format='[1]' writes the plain number")
        )
    word = form.raw(number, function, unit) if form.name else _plain(number, function)
    _check_command(function, word, options)
    return word


def command_word(word: int, options: FujiOptions) -> int:
    """Return a word for S06. Raises ValueRefusedError for bits that do not exist, and for FWD with REV."""
    mask = options.generation.command_mask if options.s06_mask is None else options.s06_mask
    if word & ~mask:
        raise ValueRefusedError(
            f"{word:04X} for parameter S06 sets bits that {options.generation.title} does not have; it has {mask:04X}"
        )
    if word & RUN == RUN:
        raise ValueRefusedError("S06 would command forward and reverse together")
    return word


def _plain(number: Decimal, function: str) -> int:
    if not -0x8000 <= number <= 0xFFFF:
        raise ValueRefusedError(f"{number} for parameter {function} does not fit into four hexadecimal digits")
    if number != int(number):
        raise ValueRefusedError(
            f"{number} for parameter {function} is not a whole number, and its format is not known; "
            "name a model or give format="
        )
    return int(number) % 0x10000


def _check_command(function: str, word: int, options: FujiOptions) -> None:
    """Check the rules for the S codes of section 5.1, which hold with and without a model."""
    if function == COMMAND:
        command_word(word, options)
    elif function == FREQUENCY_PU and FULL_SCALE < word < 0x10000 - FULL_SCALE:
        raise ValueRefusedError(f"{word} for parameter S01 is outside -{FULL_SCALE} to {FULL_SCALE}")
    elif function == FREQUENCY and options.generation.s05_is_frequency and word > 40000:
        raise ValueRefusedError(f"{word} for parameter S05 is outside 0 to 40000 (400.00 Hz)")


def address_space(options: FujiOptions, _model: Model | None) -> AddressSpace:
    """Return the functions that an inverter can have.

    options: for its generation, and for number_check, which excludes higher numbers.
    """
    profile = options.generation
    highest = profile.highest_number if options.number_check else 99
    return AddressSpace(
        addresses=lambda: (f"{letter}{number:02d}" for letter in profile.types for number in range(highest + 1)),
        absent=frozenset({FUNCTION_ERROR}),
        source=(
            "type letters and highest numbers: VXSM150-1 manual 9-15, FRENIC5000 G11S RS-485 manual p. 9, FRENIC-VG "
            "option manual 5-20, HVAC/AQUA RS-485 manual 3-5, 4-4; error 78: HVAC/AQUA RS-485 manual 4-17"
        ),
    )
