"""Complete backup: the parameters that the model knows, and all other answers of the drive as raw values."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import read_parameter
from drivecomm.commissioning.exploring import course, exploring, lasting_identity, read_identity
from drivecomm.commissioning.parameter_sets.parameter_set import Explored, ParameterEntry, ParameterSet, in_order
from drivecomm.commissioning.parameter_sets.reading_out import entry_of, read_firmware
from drivecomm.protocol import Reading

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from drivecomm.bus import Procedure
    from drivecomm.commissioning.exploring import AddressAnswer, AnswerRecord, ExplorationPlan, Progress
    from drivecomm.commissioning.parameter_sets.parameter_set import Part
    from drivecomm.commissioning.parameter_sets.reading_out import SetSubject
    from drivecomm.protocol import ParameterInfo


def backup_plan(of: SetSubject, within: Collection[str] | None = None) -> ExplorationPlan:
    """Return the addresses that a complete backup requests: first the readable ones that the model knows.

    within: limits the addresses that the model does not know to these; None for all that a drive can hold. Raises
    NotSupported if the protocol package does not list the possible addresses.
    """
    return course(of.plugin, of.model, known=_known(of), within=within)


def reading_everything(
    of: SetSubject, way: ExplorationPlan, logbook: AnswerRecord, progress: Progress
) -> Procedure[ParameterSet]:
    """Request all addresses of an exploration plan, with reads only, and return the answers as a parameter set.

    Raises FileFormatError if the logbook has answers of another drive, NoReplyError if the drive stays silent, and
    LinkError if the line is lost. The logbook keeps the answers received until then.
    """
    identity = yield from read_identity()
    logbook.begin(lasting_identity(identity))
    answers = yield from exploring(way, read_parameter, logbook, progress)
    firmware = yield from read_firmware(of, identity)
    return _set_of(of, identity, answers, firmware)


def _known(of: SetSubject) -> Mapping[str, tuple[ParameterInfo, Part]]:
    return {address: (info, part) for address, info, part in of.values_known() if "r" in info.access}


def _set_of(of: SetSubject, identity: Mapping[str, str], answers: list[AddressAnswer], firmware: str) -> ParameterSet:
    known, common = _known(of), of.common_names()
    entries: dict[str, ParameterEntry] = {}
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
                entries[address] = ParameterEntry(address=address, value=told.raw, part="unknown")
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


def _has_elements(address: str, answers: list[AddressAnswer]) -> bool:
    """Return whether a parameter was read element by element because it could not be read as a whole."""
    return any(answer.told is not None and answer.address.startswith(f"{address}[") for answer in answers)
