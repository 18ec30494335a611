"""Model made from a foreign file: monitoring only, and every fact marked as imported."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.models import factor_between, quantities
from drivecomm.protocol import Model, ParameterInfo

if TYPE_CHECKING:
    from drivecomm.commissioning.importing.foreign_contents import ForeignContents, ForeignRegister

_PROTOCOL = "modbus"
_LATIN = str.maketrans(
    dict(zip("абвгдезийклмнопрстуфхцыэ", "abvgdezijklmnoprstufhcye", strict=True))
    | {"ё": "jo", "ж": "zh", "ч": "ch", "ш": "sh", "щ": "sch", "ъ": "", "ь": "", "ю": "ju", "я": "ja", "ß": "ss"}
)
"""Latin spellings of letters that do not contain a Latin base letter, for parameter names."""


def imported_model(found: ForeignContents, *, name: str, file: str, drive: int | None = None) -> Model:
    """Return a model without orders: its drives can be read, and never commanded or written.

    A register becomes a common name if it is the only one with exactly that title and its unit fits. A register whose
    address is already in the model is recorded in found as not imported. name: name of the model. file: file name for
    the sources. drive: address of the drive whose registers are imported. Raises UsageError if the file names several
    drives and none is given, or if none of its registers belongs to that drive.
    """
    registers = _of_drive(found, drive)
    parameters: dict[str, ParameterInfo] = {}
    common: dict[str, str] = {}
    taken: set[str] = set()
    wanted = [_name(each.title) for each in registers]
    fitting = Counter(word for each, word in zip(registers, wanted, strict=True) if _is_common(word, each))
    for each, word in zip(registers, wanted, strict=True):
        if (other := parameters.get(each.address)) is not None:
            if not each.written:
                reason = f"another value of the register that is {other.name} already"
                found.leave(each.place, each.title, reason)
            continue
        called = word
        if word in quantities():
            if fitting[word] == 1 and _is_common(word, each):
                common[word] = each.address
            else:
                called = f"{word}_value"
        if not called or called in taken:
            called = f"{called or 'register'}_{re.sub(r'[^0-9a-z]+', '_', each.address.lower())}"
        taken.add(called)
        parameters[each.address] = _parameter(each, called, file)
    return Model(
        protocol=_PROTOCOL,
        name=name,
        title=found.title or name,
        source=f"imported from {file}, {found.form}",
        parameters=parameters,
        faults={},
        options=dict(found.options),
        quantities=common,
    )


def drives_of(found: ForeignContents) -> list[int]:
    """Return the addresses of the drives that a file names."""
    return sorted({each.drive for each in found.registers if each.drive is not None})


def _of_drive(found: ForeignContents, drive: int | None) -> list[ForeignRegister]:
    drives = drives_of(found)
    if drive is None and len(drives) > 1:
        named = ", ".join(map(str, drives))
        raise UsageError(f"the file reads drives {named}; choose one with --address")
    registers = [each for each in found.registers if each.drive in (None, drive) or drive is None]
    if drive is not None and drives and drive not in drives:
        raise UsageError(f"the file does not read drive {drive}, only {', '.join(map(str, drives))}")
    return registers


def _parameter(register: ForeignRegister, name: str, file: str) -> ParameterInfo:
    counted = f", there {register.counted}" if register.counted and register.counted != register.address else ""
    extra: dict[str, Any] = {}
    if register.word_order:
        extra["word_order"] = register.word_order
    if register.characters:
        extra["characters"] = register.characters
    info = ParameterInfo(
        address=register.address,
        name=name,
        title=register.title,
        type=register.type,
        unit=register.unit,
        factor=register.factor,
        access="r",
        values=register.values,
        source=f"{file}, {register.place}{counted}",
        sure="imported",
        extra=extra,
    )
    return replace(info, access="w", kind="command") if register.written else info


def _is_common(word: str, register: ForeignRegister) -> bool:
    known = quantities().get(word)
    return known is not None and not register.written and factor_between(register.unit, known.unit) is not None


def _name(title: str) -> str:
    """Return a title as a parameter name; empty if nothing of it can be written in Latin letters."""
    text = unicodedata.normalize("NFKD", title.casefold().translate(_LATIN))
    word = re.sub(r"[^a-z0-9]+", "_", "".join(each for each in text if not unicodedata.combining(each))).strip("_")
    return word if re.match("[a-z]", word) else f"p{word}" if word else ""
