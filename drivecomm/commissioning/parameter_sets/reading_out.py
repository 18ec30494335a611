"""Backup: reading the parameters of a drive into a parameter set."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.bus import ask_identity, ask_status, read_parameter
from drivecomm.commissioning.parameter_sets.parameter_set import Entry, ParameterSet, in_order
from drivecomm.commissioning.parameter_sets.subject import part_of
from drivecomm.errors import DriveError, ReplyError, UnexpectedReplyError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping
    from datetime import datetime

    from drivecomm.bus import Procedure
    from drivecomm.commissioning.parameter_sets.parameter_set import Part
    from drivecomm.commissioning.parameter_sets.subject import Subject
    from drivecomm.protocol import ParameterInfo, Reading

    Progress = Callable[[str, int, int], None]


def reading_out(of: Subject, parts: Collection[Part], progress: Progress) -> Procedure[ParameterSet]:
    """Read all parameters of these parts. What the drive refuses to tell is listed with its reason.

    Raises ReplyError and LinkError when the drive or the line is away; a set is whole or there is none.
    """
    identity = yield from identity_told()
    return (yield from _read(of, parts, {}, identity, progress))


def factory_values(of: Subject, parts: Collection[Part], progress: Progress) -> Procedure[ParameterSet]:
    """Read the factory values of all parameters of these parts, where drives of this protocol tell them.

    Raises UsageError where they do not.
    """
    options = of.plugin.factory_reading
    if not options:
        raise UsageError(
            f"no {of.protocol} drive tells its factory values, and no source that was read lists them; back the drive "
            "up right after a reset to its factory settings, and compare with that file"
        )
    return (yield from _read(of, parts, options, {}, progress))


def identity_told() -> Procedure[Mapping[str, str]]:
    """Return what the drive tells of itself, nothing where it refuses; its state says nothing of what it is."""
    try:
        told: Mapping[str, str] = yield ask_identity()
    except DriveError:
        return {}
    return {key: text for key, text in told.items() if key != "state"}


def _read(
    of: Subject, parts: Collection[Part], options: Mapping[str, Any], identity: Mapping[str, str], progress: Progress
) -> Procedure[ParameterSet]:
    common = of.common_names()
    wanted = [
        (address, info, part)
        for info in of.model.parameters.values()
        if (part := part_of(info)) in parts and part is not None
        for address in of.addresses_of(info)
    ]
    entries: dict[str, Entry] = {}
    not_read: dict[str, str] = {}
    time: datetime | None = None
    for done, (address, info, part) in enumerate(wanted):
        progress(address, done, len(wanted))
        if "r" not in info.access:
            not_read[address] = "it can only be written"
            continue
        # A factory value is told for a parameter as a whole.
        asked = info.address if options else address
        try:
            reading = yield from _reading(asked, options)
        except (DriveError, UsageError, ReplyError) as error:
            if isinstance(error, ReplyError) and not isinstance(error, UnexpectedReplyError):
                yield from _must_be_there(error)
            not_read[address] = " ".join(str(error).split())
            continue
        time = time or reading.time.replace(microsecond=0)
        entries[address] = _entry(address, info, reading, part, common.get(address) or common.get(info.address, ""))
    progress("", len(wanted), len(wanted))
    return ParameterSet(
        protocol=of.protocol,
        drive=of.name,
        model=of.model.name,
        firmware=(yield from _firmware(of, identity)),
        identity=identity,
        entries={address: entries[address] for address in in_order(entries)},
        not_read={address: not_read[address] for address in in_order(not_read)},
        time=time,
    )


def _reading(address: str, options: Mapping[str, Any]) -> Procedure[Reading]:
    """Read, and once more where nothing believable came though the drive is there."""
    try:
        return (yield read_parameter(address, options))  # type: ignore[no-any-return]
    except UnexpectedReplyError:
        raise
    except ReplyError as error:
        yield from _must_be_there(error)
    return (yield read_parameter(address, options))  # type: ignore[no-any-return]


def _must_be_there(error: ReplyError) -> Procedure[None]:
    """Raise the error unless the drive answers something else: then it is about the parameter."""
    try:
        yield ask_status()
    except ReplyError:
        raise error from None
    except DriveError:
        return


def _entry(address: str, info: ParameterInfo, reading: Reading, part: Part, common: str) -> Entry:
    says_no_more = str(reading.raw) == str(reading.value)
    return Entry(
        address=address,
        name=info.name,
        value=reading.value,
        unit=reading.unit,
        raw=None if says_no_more else reading.raw,
        common=common,
        part=part,
        meaning=reading.text,
    )


def _firmware(of: Subject, identity: Mapping[str, str]) -> Procedure[str]:
    """Return the version of the software, by its common name or else by what the drive calls it."""
    if "software_version" in of.model.quantities:
        try:
            reading: Reading = yield read_parameter("software_version")
        except (DriveError, UsageError, ReplyError):
            pass
        else:
            return str(reading.value)
    return next((text for key, text in identity.items() if _is_firmware(key)), "")


def _is_firmware(key: str) -> bool:
    return any(word in key.lower() for word in ("software", "firmware", "version"))
