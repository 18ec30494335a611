"""Parameter addresses such as `481`, `520[2]` and `fixed_frequency_2`, and the conversion of their values."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError, UnexpectedReplyError, UsageError, ValueRefusedError
from drivecomm.protocol import AddressSpace, Elements, Value, must_know_type, new_reading, scaled, whole_number
from drivecomm_vabus.errorcodes import DATASET_NOT_PERMITTED, DATASETS_DIFFER, UNKNOWN_PARAMETER
from drivecomm_vabus.telegrams import DATASETS, PARAMETERS, VALUE_TYPES, ValueType, data_of, number_of, range_of

if TYPE_CHECKING:
    from drivecomm.protocol import Model, ParameterInfo, Reading
    from drivecomm_vabus.options import VabusOptions

_ADDRESS = re.compile(r"(?P<hundreds>\d{0,2}|[A-F])(?P<rest>\d{1,2})(?:\[(?P<dataset>\d)\])?", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class VabusTarget:
    """A parameter in a data set, with its model data. dataset: None if the address names none."""

    number: int
    dataset: int | None
    type: ValueType
    info: ParameterInfo | None

    @cached_property
    def address(self) -> str:
        """The parameter address in its simplest form."""
        return str(self.number) if self.dataset is None else f"{self.number}[{self.dataset}]"


def target(parameter: str, model: Model | None, type: str, dataset: int | None) -> VabusTarget:
    """Return the target of a parameter address or of a name in the model.

    Numbers run from 0 to 1599, and those from 1000 on may be written A00 to F99; the data set is in brackets. Raises
    ParameterAddressError for anything else.
    """
    name = parameter.partition("[")[0]
    known = model.find(name) if model else None
    match = _ADDRESS.fullmatch(known.address + parameter[len(name) :] if known else parameter)
    if match is None:
        remedy = f"nor a name of model {model.name}" if model else "such as 481, 520[2] or C00"
        raise ParameterAddressError(f"{parameter!r} is not a VABus parameter address {remedy}")
    hundreds = match["hundreds"]
    number = int(hundreds, 16) * 100 + int(match["rest"]) if hundreds.isalpha() else int(hundreds + match["rest"])
    if number not in PARAMETERS:
        raise ParameterAddressError(f"parameter {number} is beyond 1599, the highest that VABus can name")
    if match["dataset"] is not None:
        if dataset is not None and dataset != int(match["dataset"]):
            raise UsageError(f"{parameter} names data set {match['dataset']}, and dataset={dataset} another")
        dataset = int(match["dataset"])
    if dataset is not None and dataset not in DATASETS:
        raise ParameterAddressError(f"data set {dataset} does not exist; data sets are 0 to 9")
    info = known or (model.find(str(number)) if model else None)
    chosen: Any = type or (info.type if info else "")
    if chosen not in ("", *VALUE_TYPES):
        raise UsageError(f"{chosen!r} is not a VABus type; they are {', '.join(VALUE_TYPES)}")
    return VabusTarget(number=number, dataset=dataset, type=chosen, info=info)


def element_addresses(info: ParameterInfo, _options: VabusOptions) -> tuple[str, ...]:
    """Return the addresses of a parameter's values: in data sets 1 to 4, or its only one."""
    if info.extra.get("datasets") != 4:
        return (info.address,)
    return tuple(f"{info.address}[{dataset}]" for dataset in range(1, 5))


def reading_of(wanted: VabusTarget, data: str, *, lower_case_hex: bool) -> Reading:
    """Return the reading for a value's data characters.

    Without a type only the characters are certain: 0x000003E8 in eight characters may be a long or a text. Raises
    UnexpectedReplyError if the characters are not a value of the type.
    """
    info, note, text = wanted.info, "", ""
    value: Value = data
    if wanted.type == "":
        note = "type not known: these are the characters as sent"
    elif wanted.type != "string":
        try:
            value = raw = number_of(data, wanted.type, lower_case_hex=lower_case_hex)
        except ValueError as error:
            raise UnexpectedReplyError(f"parameter {wanted.address} is not of type {wanted.type}: {error}") from error
        if info is not None:
            value, text = scaled(raw, info.factor), info.values.get(raw, "")
            note = info.note
    return new_reading(
        parameter=wanted.address,
        name=info.name if info else "",
        value=value,
        raw=data,
        type=wanted.type,
        unit=info.unit if info and wanted.type else "",
        text=text,
        note=note,
    )


def characters_for(wanted: VabusTarget, value: Value | float) -> str:
    """Return the data characters for a value; the value is physical if the model has the scale.

    Raises ValueRefusedError for a value that does not fit, UsageError if the type is unknown.
    """
    must_know_type(wanted.type, VALUE_TYPES, wanted.address)
    if wanted.type == "string":
        text = str(value)
        if not 1 <= len(text) <= 99 or not all(0x20 <= ord(character) <= 0x7E for character in text):
            raise ValueRefusedError(
                f"{text!r} for parameter {wanted.address} is not 1 to 99 printable ASCII characters"
            )
        return text
    raw = whole_number(value, wanted.address, wanted.info, wanted.type, range_of(wanted.type))
    return data_of(raw, wanted.type)


def address_space(_options: VabusOptions, _model: Model | None) -> AddressSpace:
    """Return the addresses that a drive can hold; neither options nor model restrict them."""
    return AddressSpace(
        addresses=lambda: map(str, PARAMETERS),
        absent=frozenset({UNKNOWN_PARAMETER, DATASET_NOT_PERMITTED}),
        source="0 to 999 and A00 to F99: Agile VABus manual p. 30; data sets: the same page, and Agile manual p. 43",
        elements=_data_sets,
        together={"datasets": 4},
    )


def _data_sets(address: str, code: int | None) -> Elements:
    """Return the data sets of a parameter whose four values differ.

    Refused in data set 0, it answers in 0 to 4 only (the same pages).
    """
    if code != DATASETS_DIFFER:
        return Elements()
    return Elements(runs=(tuple(f"{address}[{dataset}]" for dataset in range(1, 5)),))
