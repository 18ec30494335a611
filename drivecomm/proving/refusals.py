"""Refusal codes, provoked by reading addresses that the model does not know, and elements that do not exist."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, ParameterAddressError, RefusedError, ReplyError, in_one_line
from drivecomm.proving.findings import ProofFinding

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from drivecomm.protocol import AddressSpace, Model, Protocol, Reading
    from drivecomm.proving.parameters import ParameterAnswers

_ASKED = 3
_ELEMENTS_ASKED = 2


@dataclass(frozen=True, slots=True)
class Provocation:
    """A read that a drive must refuse. of: the parameter whose element is read; empty if there is no such parameter."""

    address: str
    of: str = ""


def provocations(plugin: Protocol, model: Model, options: Any) -> Sequence[Provocation]:
    """Return reads that a drive must refuse; none if its protocol does not define its address space.

    The addresses are spread over the whole address space, and none of them is in the model.
    """
    space = _space(plugin, model, options)
    if space is None:
        return ()
    operations = plugin.operations(plugin.addresses[0], options, model)
    addresses = list(space.addresses())
    taken = {operations.address_of(each) for each in model.parameters}
    found: list[Provocation] = []
    for share in range(_ASKED):
        # Search each part from its end, where makers leave addresses free.
        begin = len(addresses) * (_ASKED - share) // _ASKED - 1
        free = (each for each in reversed(addresses[: begin + 1]) if operations.address_of(each) not in taken)
        address = next(free, "")
        if address and all(each.address != address for each in found):
            found.append(Provocation(address))
    for info in model.parameters.values():
        elements = plugin.element_addresses(info, options)
        if len(elements) != 1 or elements[0] != info.address or "r" not in info.access or info.kind == "command":
            continue
        runs = space.elements(info.address, None).runs
        beyond = space.elements(info.address, None).beyond or (runs[0][0] if runs else "")
        if beyond and len(found) < _ASKED + _ELEMENTS_ASKED:
            found.append(Provocation(beyond, info.address))
    return found


def refusal_finding(
    provoked: Provocation,
    answer: Reading | DriveCommError,
    absent: Collection[int],
    told: Mapping[str, ParameterAnswers],
) -> ProofFinding:
    """Return the finding about the protocol's refusal codes that follows from an answer."""
    codes = sorted(absent)
    about = f"the refusal of {provoked.address}, " + (
        f"which {provoked.of} has no element for" if provoked.of else "which the model does not know"
    )
    model = {"codes": codes}
    if isinstance(answer, ParameterAddressError):
        return ProofFinding(kind="refusal", verdict="not asked", about=about, why=in_one_line(answer))
    if isinstance(answer, RefusedError):
        said = {"code": answer.code} if answer.code is not None else {}
        if answer.code in absent:
            return ProofFinding(kind="refusal", verdict="agrees", about=about, model=model, drive=said)
        why = (
            f"the drive refused it with code {answer.code}, and the protocol has {', '.join(map(str, codes))} for that"
        )
        return ProofFinding(kind="refusal", verdict="contradicts", about=about, model=model, drive=said, why=why)
    if isinstance(answer, ReplyError):
        why = "the drive does not answer it, and the protocol has a code for that"
        return ProofFinding(kind="refusal", verdict="contradicts", about=about, model=model, why=why)
    if isinstance(answer, DriveCommError):
        return ProofFinding(kind="refusal", verdict="contradicts", about=about, model=model, why=in_one_line(answer))
    first = told.get(provoked.of)
    same = first is not None and any(
        not isinstance(each, DriveCommError) and each.raw == answer.raw for each in first.readings.values()
    )
    why = (
        "the drive does not look at the element"
        if same
        else "the drive returned a value, which the model does not know"
    )
    return ProofFinding(kind="refusal", verdict="new", about=about, model=model, why=why)


def absent_codes(plugin: Protocol, model: Model, options: Any) -> Collection[int]:
    """Return the codes for a missing parameter or element."""
    space = _space(plugin, model, options)
    return space.absent if space is not None else ()


def _space(plugin: Protocol, model: Model, options: Any) -> AddressSpace | None:
    return None if plugin.address_space is None else plugin.address_space(options, model)
