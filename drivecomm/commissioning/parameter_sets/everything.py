"""Backup of everything: what the model knows of a drive, and what else the drive answers, as it came."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import read_parameter
from drivecomm.commissioning.exploring import course, exploring, identity_told, lasting
from drivecomm.commissioning.parameter_sets.parameter_set import Entry, Explored, ParameterSet, in_order
from drivecomm.commissioning.parameter_sets.reading_out import entry_of, firmware_told
from drivecomm.protocol import Reading

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from drivecomm.bus import Procedure
    from drivecomm.commissioning.exploring import Answer, Course, Progress, Remembers
    from drivecomm.commissioning.parameter_sets.parameter_set import Part
    from drivecomm.commissioning.parameter_sets.reading_out import Subject
    from drivecomm.protocol import ParameterInfo


def way_through(of: Subject, within: Collection[str] | None = None) -> Course:
    """Return which addresses a backup of everything asks for: first what its model knows and may be read.

    within: of what the model does not know only these; all that a drive can hold unless given. Raises NotSupported
    where the protocol's package does not tell what that is.
    """
    return course(of.plugin, of.model, known=_known(of), within=within)


def reading_everything(of: Subject, way: Course, logbook: Remembers, progress: Progress) -> Procedure[ParameterSet]:
    """Ask for all addresses of a way, with reads only, and return what the drive told.

    Raises FileFormatError when the logbook has answers of another drive, NoReplyError when the drive stays silent, and
    LinkError when the line is lost; the logbook has what was answered until then.
    """
    identity = yield from identity_told()
    logbook.begin(lasting(identity))
    answers = yield from exploring(way, read_parameter, logbook, progress)
    firmware = yield from firmware_told(of, identity)
    return _set_of(of, identity, answers, firmware)


def _known(of: Subject) -> Mapping[str, tuple[ParameterInfo, Part]]:
    return {address: (info, part) for address, info, part in of.values_known() if "r" in info.access}


def _set_of(of: Subject, identity: Mapping[str, str], answers: list[Answer], firmware: str) -> ParameterSet:
    known, common = _known(of), of.common_names()
    entries: dict[str, Entry] = {}
    not_read = {address: "it can only be written" for address, info, _ in of.values_known() if "r" not in info.access}
    times = []
    for answer in answers:
        address, told = answer.address, answer.told
        if isinstance(told, Reading):
            times.append(told.time)
            if address in known:
                info, part = known[address]
                name = common.get(address) or common.get(info.address, "")
                entries[address] = entry_of(address, info, told, part, name)
            else:
                entries[address] = Entry(address=address, value=told.raw, part="unknown")
        elif address in known or not (answer.absent or _has_elements(address, answers)):
            not_read[address] = answer.reason
    return ParameterSet(
        protocol=of.protocol,
        drive=of.name,
        model=of.model.name,
        firmware=firmware,
        identity=identity,
        entries={address: entries[address] for address in in_order(entries)},
        not_read={address: not_read[address] for address in in_order(not_read)},
        time=min(times).replace(microsecond=0) if times else None,
        explored=Explored(
            asked=len(answers),
            answered=len(entries),
            known=sum(entry.part != "unknown" for entry in entries.values()),
        ),
    )


def _has_elements(address: str, answers: list[Answer]) -> bool:
    """Whether a parameter was told element by element, where it was not as a whole."""
    return any(answer.told is not None and answer.address.startswith(f"{address}[") for answer in answers)
