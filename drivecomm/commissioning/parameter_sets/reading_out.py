"""Backup of a drive's parameters into a parameter set, and checks that two sets are of the same drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.bus import in_ram_only, read_parameter
from drivecomm.commissioning.exploring import is_there, lasting_identity, read_identity
from drivecomm.commissioning.parameter_sets.parameter_set import ParameterEntry, ParameterSet, in_order
from drivecomm.errors import DriveError, ReplyError, UnexpectedReplyError, UsageError, in_one_line
from drivecomm.models import quantities
from drivecomm.protocol import installed, resolve_options

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping
    from datetime import datetime

    from drivecomm.bus import AsyncDrive, Drive, Procedure
    from drivecomm.commissioning.parameter_sets.parameter_set import Part
    from drivecomm.protocol import Capabilities, Model, ParameterInfo, Protocol, Reading

    Progress = Callable[[str, int, int], None]


def no_progress(_address: str, _done: int, _total: int) -> None:
    """Ignore the progress; default callback."""


IN_RAM = "it was written to RAM, so what the drive stores is not known"
"""Reason why a set has no value of a parameter that the same program wrote to RAM only."""


def reading_out(of: SetSubject, parts: Collection[Part], progress: Progress) -> Procedure[ParameterSet]:
    """Read all parameters of these parts; the set lists those that the drive refuses, with the reason.

    Raises ReplyError or LinkError if the drive or the line does not respond, so that a set is never partial.
    """
    identity = yield from read_identity()
    return (yield from _read(of, parts, {}, identity, progress))


def factory_values(of: SetSubject, parts: Collection[Part], progress: Progress) -> Procedure[ParameterSet]:
    """Read the factory values of all parameters of these parts, if drives of this protocol report them.

    Raises UsageError if they do not.
    """
    options = of.plugin.factory_reading
    if not options:
        raise UsageError(
            f"no {of.protocol} drive reports its factory values, and no source that was read lists them; back the "
            "drive up right after a reset to its factory settings, and compare with that file"
        )
    return (yield from _read(of, parts, options, {}, progress))


def _read(
    of: SetSubject, parts: Collection[Part], options: Mapping[str, Any], identity: Mapping[str, str], progress: Progress
) -> Procedure[ParameterSet]:
    common = of.common_names()
    wanted = [each for each in of.values_known() if each[2] in parts]
    in_ram: Collection[str] = yield in_ram_only()
    entries: dict[str, ParameterEntry] = {}
    not_read: dict[str, str] = {}
    time: datetime | None = None
    for done, (address, info, part) in enumerate(wanted):
        progress(address, done, len(wanted))
        if "r" not in info.access:
            not_read[address] = "it can only be written"
            continue
        if info.address in in_ram and part != "measured":
            not_read[address] = IN_RAM
            continue
        # A drive reports the factory value of a parameter as a whole, not of its elements.
        asked = info.address if options else address
        try:
            reading = yield from _reading(asked, options)
        except (DriveError, UsageError, ReplyError) as error:
            if isinstance(error, ReplyError) and not isinstance(error, UnexpectedReplyError):
                yield from _must_be_there(error)
            not_read[address] = in_one_line(error)
            continue
        time = time or reading.time.replace(microsecond=0)
        entries[address] = entry_of(address, info, reading, part, common.get(address) or common.get(info.address, ""))
    progress("", len(wanted), len(wanted))
    return ParameterSet(
        protocol=of.protocol,
        drive=of.name,
        model=of.model.name,
        firmware=(yield from read_firmware(of, identity)),
        identity=identity,
        entries={address: entries[address] for address in in_order(entries)},
        not_read={address: not_read[address] for address in in_order(not_read)},
        time=time,
    )


def _reading(address: str, options: Mapping[str, Any]) -> Procedure[Reading]:
    """Read a parameter; retry once after an invalid reply or silence if the drive answers other requests."""
    try:
        return (yield read_parameter(address, options))  # type: ignore[no-any-return]
    except UnexpectedReplyError:
        raise
    except ReplyError as error:
        yield from _must_be_there(error)
    return (yield read_parameter(address, options))  # type: ignore[no-any-return]


def _must_be_there(error: ReplyError) -> Procedure[None]:
    """Raise the error unless the drive answers another request: then the error concerns only the parameter."""
    if not (yield from is_there()):
        raise error from None


def entry_of(address: str, info: ParameterInfo, reading: Reading, part: Part, common: str) -> ParameterEntry:
    """Return a reading as an entry of a parameter set."""
    says_no_more = str(reading.raw) == str(reading.value)
    return ParameterEntry(
        address=address,
        name=info.name,
        value=reading.value,
        unit=reading.unit,
        raw=None if says_no_more else reading.raw,
        common=common,
        part=part,
        meaning=reading.text,
    )


def read_firmware(of: SetSubject, identity: Mapping[str, str]) -> Procedure[str]:
    """Return the software version, by its common name or else by the field of the drive's identity."""
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


@dataclass(frozen=True, slots=True)
class SetSubject:
    """Name, model and capabilities of a drive for parameter sets. options: protocol options of the model."""

    name: str
    plugin: Protocol
    model: Model
    options: Any
    capabilities: Capabilities

    @property
    def protocol(self) -> str:
        """Name of the drive's protocol."""
        return self.plugin.name

    def values_known(self) -> Iterator[tuple[str, ParameterInfo, Part]]:
        """Yield the values that the model knows, without commands: address, parameter, part of a set."""
        return values_known(self.model, self.plugin, self.options)

    @property
    def references(self) -> frozenset[str]:
        """Addresses of the parameters that a bus uses as references."""
        return self.plugin.references(self.options, self.model)

    def info(self, address: str) -> ParameterInfo | None:
        """Return the model's description of the parameter at an address, None if the model does not know it."""
        return self.model.parameters.get(address) or self.model.parameters.get(address.partition("[")[0])

    def common_names(self) -> Mapping[str, str]:
        """Return the common name of each address that the model maps."""
        known = quantities()
        return {address: name for name, address in self.model.quantities.items() if name in known}


def subject(drive: Drive | AsyncDrive) -> SetSubject:
    """Return a drive as a subject of parameter sets. Raises UsageError for a drive without a model."""
    if drive.model is None:
        raise UsageError(f"{drive.name}: its parameters are not known without a model; name one, such as with --model")
    protocol = drive.name.partition(":")[0]
    plugin = installed[protocol]
    _, options = resolve_options(plugin, drive.model, {})
    return SetSubject(drive.name, plugin, drive.model, options, drive.capabilities)


def values_known(model: Model, plugin: Protocol, options: Any) -> Iterator[tuple[str, ParameterInfo, Part]]:
    """Yield the values that a model knows, without commands: address, parameter, part of a set."""
    references = plugin.references(options, model)
    for info in model.parameters.values():
        if (part := part_of(info, references)) is not None:
            for address in plugin.element_addresses(info, options):
                yield address, info, part


def part_of(info: ParameterInfo, references: Collection[str] = ()) -> Part | None:
    """Return the part of a parameter set to which a parameter belongs; None for a command.

    references: addresses of the parameters that a bus uses as references.
    """
    if "w" not in info.access:
        return "measured"
    if info.kind == "command":
        return None
    if info.kind == "communication":
        return "communication"
    # A value that is lost without power is a reference or a command of the bus, not a setting.
    return "measured" if info.storage == "volatile" or info.address in references else "settings"


def of_another_drive(known: ParameterSet, there: ParameterSet) -> str:
    """Return evidence that a parameter set is not of the drive on the line; empty if there is none.

    there: the drive as it is now; its entries are ignored.
    """
    if known.protocol != there.protocol:
        return f"it is of a {known.protocol} drive, and {there.drive} is not one"
    if known.model != there.model:
        return f"it is of model {known.model}, and {there.drive} is opened as {there.model}"
    if known.drive != there.drive:
        return f"it is of {known.drive}, and the drive is {there.drive}"
    return next(_differences(known.identity, there.identity), "")


def identity_changes(before: ParameterSet, after: ParameterSet) -> list[str]:
    """Return the differences between the identities and firmware in two sets of one drive, as sentences."""
    told = list(_differences(before.identity, after.identity, "there"))
    if before.firmware != after.firmware and before.protocol == after.protocol:
        told.append(f"firmware is {before.firmware or 'not known'} here and {after.firmware or 'not known'} there")
    return told


def _differences(before: Mapping[str, str], after: Mapping[str, str], where: str = "on this drive") -> Iterator[str]:
    for key, text in lasting_identity(before).items():
        if key in after and after[key] != text:
            yield f"its {key} is {text!r}, and {after[key]!r} {where}"
