"""Descriptions of parameters from the drive itself: description elements and option texts, as one `ParameterInfo`.

AK 4 and its elements: VLT 5000 Design Guide p. 95-98, VLT 5000 Crane manual p. 105-106; option texts: VLT 5000 Design
Guide p. 99.
"""

from __future__ import annotations

import re
from decimal import Decimal
from typing import TYPE_CHECKING

from drivecomm.errors import RefusedError, UsageError
from drivecomm.protocol import ParameterInfo
from drivecomm_danfoss_fc import access
from drivecomm_danfoss_fc.description_elements import (
    BASIC,
    CONVERSION,
    DEFAULT,
    ELEMENTS,
    LOWER_LIMIT,
    NAME,
    UPPER_LIMIT,
    unit_and_factor,
)
from drivecomm_danfoss_fc.parameters import DATA_TYPES, TYPES_BY_NUMBER, bits_of, signed, value_in_type
from drivecomm_danfoss_fc.tables import NO_SUCH_ELEMENT

if TYPE_CHECKING:
    from drivecomm.profiles import ProcessWords
    from drivecomm.protocol import Exchange, Reading
    from drivecomm_danfoss_fc.parameters import DanfossFcParameter

SOURCE = "read from the drive, AK 4"

_ARRAY_FLAG, _OPTION_TEXTS_FLAG, _READ_ONLY_FLAG, _NO_LIMITS_FLAG = 14, 10, 9, 8

_OPTIONS = range(254)


def describe(talk: ProcessWords, wanted: DanfossFcParameter, option_texts: int) -> Exchange[ParameterInfo]:
    """Read the description of a parameter from the drive, with the texts of up to `option_texts` option values.

    A type that the protocol cannot carry, such as a byte string, is left empty. Raises RefusedError if the drive has no
    such parameter or does not describe it, UsageError for an impossible number of texts.
    """
    if type(option_texts) is not int or option_texts not in range(len(_OPTIONS) + 1):
        raise UsageError(f"{option_texts!r} option texts cannot be read: IND names 254 options, 0 to 253")
    basic = int((yield from access.read_element(talk, wanted, BASIC)).raw)
    number, flags = basic & 0xFF, {bit for bit in range(8, 16) if basic >> bit & 1}
    kind = TYPES_BY_NUMBER.get(number, "")
    told = yield from _maybe_element(talk, wanted, NAME)
    title = " ".join(str(told.value).split()) if told else ""
    extra: dict[str, object] = {}
    if number not in DATA_TYPES.values():
        extra["data_type"] = number
    if _ARRAY_FLAG in flags:
        extra["elements"] = int((yield from access.read_element(talk, wanted, ELEMENTS)).raw)
    unit, factor, limits = "", Decimal(1), list[int | None]([None] * 3)
    if kind not in ("", "text"):
        conversion = yield from _maybe_element(talk, wanted, CONVERSION)
        if conversion is not None:
            index = signed(int(conversion.raw) >> 8 & 0xFF, 8)
            extra["conversion_index"] = index
            unit, factor = unit_and_factor(index, int(conversion.raw) & 0xFF)
        if _NO_LIMITS_FLAG not in flags:
            limits = yield from _limits(talk, wanted, kind)
    values: dict[int, str] = {}
    if _OPTION_TEXTS_FLAG in flags:
        values = yield from _option_texts(talk, wanted, limits, option_texts)
    lowest, highest, default = (None if each is None else each * factor for each in limits)
    return ParameterInfo(
        address=wanted.name,
        name=_name_from(title, wanted),
        title=title or f"parameter {wanted.name}",
        type=kind,
        unit=unit,
        factor=factor,
        access="r" if _READ_ONLY_FLAG in flags else "rw",
        values=values,
        minimum=lowest,
        maximum=highest,
        start=default,
        source=SOURCE,
        sure="field",
        extra=extra,
    )


def _maybe_element(talk: ProcessWords, wanted: DanfossFcParameter, element: int) -> Exchange[Reading | None]:
    """Read a description element; None if the parameter does not have it."""
    try:
        return (yield from access.read_element(talk, wanted, element))
    except RefusedError as refused:
        if refused.code != NO_SUCH_ELEMENT:
            raise
        return None


def _limits(talk: ProcessWords, wanted: DanfossFcParameter, kind: str) -> Exchange[list[int | None]]:
    """Return lower limit, upper limit and default as raw numbers of the drive."""
    found: list[int | None] = []
    for element in (LOWER_LIMIT, UPPER_LIMIT, DEFAULT):
        told = yield from _maybe_element(talk, wanted, element)
        found.append(None if told is None else value_in_type(int(told.raw), kind, bits_of(kind)))
    return found


def _option_texts(
    talk: ProcessWords, wanted: DanfossFcParameter, limits: list[int | None], most: int
) -> Exchange[dict[int, str]]:
    """Return the texts of the option values within the limits, of at most `most` values from the first one on."""
    lowest, highest, _ = limits
    first, end = max(0, lowest or 0), len(_OPTIONS) if highest is None else highest + 1
    texts = {}
    for option in _OPTIONS[first : max(0, min(end, first + most))]:
        try:
            text = str((yield from access.read_option_text(talk, wanted, option)).value)
        except RefusedError:
            # A value without a text is not an option: the numbers of an option parameter have gaps.
            continue
        if text:
            texts[option] = text
    return texts


def _name_from(title: str, wanted: DanfossFcParameter) -> str:
    words = re.findall(r"[a-z0-9]+", title.lower())
    return "_".join(words) or "parameter_" + "_".join(re.findall(r"\d+", wanted.name))
