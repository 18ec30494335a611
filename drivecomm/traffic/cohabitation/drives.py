"""One drive of the line: the requests to it, its replies, and the requests that it accepts."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError
from drivecomm.models import load_model
from drivecomm.protocol import Ask, Tell, fields_of, installed, resolve_options
from drivecomm.traffic.cohabitation import alphabets, sampling
from drivecomm.traffic.cohabitation.outlines import TelegramOutline, has_address, limited_to, outline_of, with_addresses
from drivecomm.virtual import virtual_drive

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from drivecomm.protocol import Codec, Direction, DriveConfig, Exchange, Message, Protocol
    from drivecomm.protocol.schema import Leaf

_DIRECTIONS: tuple[Direction, Direction] = ("request", "reply")
_ADDRESSING = ("special", "broadcast", "address")


class ProtocolOutlines:
    """The telegrams of a protocol with certain options, for any address."""

    def __init__(self, plugin: Protocol, codec: Codec) -> None:
        self.plugin, self.codec = plugin, codec

    @cached_property
    def written(self) -> Sequence[TelegramOutline]:
        """All telegrams as the protocol writes them, without the forms that are only read."""
        written = [
            sampling.with_constants(
                limited_to(outline_of(each.title, each.form, each.direction, alphabets.written), each), self.codec
            )
            for each in self._outlines
        ]
        return [each for each in written if all(place.allowed for place in each.places)]

    @cached_property
    def read(self) -> Sequence[TelegramOutline]:
        """All telegrams as they may be read.

        Telegrams that name no drive are left out if others of their direction name one.
        """
        return [each for each in self._outlines if has_address(each.form) or each.direction in self.anonymous]

    @cached_property
    def anonymous(self) -> Collection[Direction]:
        """The directions in which no telegram names a drive, so that each may be to or from any drive."""
        return set(_DIRECTIONS) - {each.direction for each in self._outlines if has_address(each.form)}

    def read_as(self, direction: Direction) -> Sequence[TelegramOutline]:
        """Return the telegrams of one direction, as they may be read, with any address."""
        return [each for each in self.read if each.direction == direction]

    @cached_property
    def _outlines(self) -> Sequence[TelegramOutline]:
        found = []
        for title, form in self.plugin.forms().items():
            ways = [outline_of(title, form, direction, alphabets.readable) for direction in _DIRECTIONS]
            known = [sampling.sampled_outline(each, self.codec) for each in ways]
            if not any(known):
                known = sampling.sampled_more(ways, self.codec)
            # If no trial shows the direction of a form, keep both directions.
            found.extend([each for each in known if each] or ways)
        return found


class LineDrive:
    """A drive as a participant in the line's traffic. Raises UsageError for a drive that cannot exist.

    dialect: its telegrams as the master knows them. ear: the codec of the drive itself. settings: its line settings.
    """

    def __init__(self, drive: DriveConfig, dialects: dict[tuple[str, str], ProtocolOutlines]) -> None:
        self._drive, self._dialects = drive, dialects
        virtual = replace(drive, machine=None).build(virtual_drive)
        self.name, self.address, self.settings = drive.name, drive.address, virtual.settings
        self.ear: Codec = virtual.codec
        self._shared = getattr(virtual, "shared_addresses", ())
        plugin = installed[drive.protocol]
        given = dict(drive.options)
        model = load_model(plugin.package, plugin.name, given.pop("model", None) or plugin.default_model)
        _, options = resolve_options(plugin, model, given)
        known = (plugin.name, repr(options))
        self.dialect = dialects.setdefault(known, ProtocolOutlines(plugin, plugin.codec(options)))
        operations = plugin.operations(drive.address, options, model)
        self._asking: list[Callable[[], Exchange[Any]]] = [operations.probe]
        self._asking += [partial(operations.read, each) for each in plugin.parameter_examples[:1]]

    def at(self, address: int) -> LineDrive:
        """Return the same drive at another address."""
        return LineDrive(replace(self._drive, address=address), self._dialects)

    @cached_property
    def spoken(self) -> Sequence[TelegramOutline]:
        """The telegrams of the master to this drive or to all drives of its protocol, and the replies of this drive."""
        return [each for plain in self.dialect.written for each in with_addresses(plain, self._says)]

    @cached_property
    def understood(self) -> Sequence[TelegramOutline]:
        """The requests that this drive accepts as its own."""
        return [each for each in self._read if each.direction == "request"]

    @cached_property
    def answers(self) -> Sequence[TelegramOutline]:
        """The replies that the master accepts as those of this drive."""
        return [each for each in self._read if each.direction == "reply" and not each.to_all]

    def is_meant(self, message: Message) -> bool:
        """Whether a request is for this drive, for its group, or for all drives of its protocol."""
        # The address may be a property that is derived from a field with another name.
        fields = {name: getattr(message, name) for name in _ADDRESSING if hasattr(message, name)}
        return "address" in fields and (self._addressed(fields) is not None or fields["address"] in self._shared)

    def is_from(self, message: Message) -> bool:
        """Whether a reply names this drive as its sender."""
        known = self.address if "reply" in self.dialect.anonymous else None
        return bool(getattr(message, "address", known) == self.address)

    def sends(self, data: bytes, outline: TelegramOutline) -> bool:
        """Whether these bytes are a telegram of this form, exactly as the protocol writes it."""
        return self.settled(data, outline) == data

    def settled(self, data: bytes, outline: TelegramOutline) -> bytes | None:
        """Return the telegram as the protocol encodes it again after decoding; None if the bytes are invalid."""
        return sampling.round_trip(data, outline, self.dialect.codec)

    @cached_property
    def _read(self) -> Sequence[TelegramOutline]:
        means = self._means
        return [each for plain in self.dialect.read for each in with_addresses(plain, means)]

    def _addressed(self, fields: Mapping[str, Any]) -> bool | None:
        """Return True if the fields address all drives, and False if they address this drive.

        Return None for another drive or a special address.
        """
        if fields.get("special") is True:
            return None
        address, everybody = fields["address"], self.dialect.plugin.broadcast_address
        if fields.get("broadcast") is True or address is None or (everybody is not None and address == everybody):
            return True
        return False if address == self.address else None

    def _means(self, fields: Mapping[str, Any], data: bytes, leaf: Leaf) -> bool | None:  # noqa: ARG002 - `_says` has the same signature
        return self._addressed(fields)

    def _says(self, fields: Mapping[str, Any], data: bytes, leaf: Leaf) -> bool | None:
        """Return the same as `_addressed`, but None for address fields that requests to this drive never carry."""
        if not any(all(fields.get(name, value) == value for name, value in each.items()) for each in self._manners):
            return None
        to_all = self._addressed(fields)
        return to_all if to_all is not None and alphabets.is_written(leaf, data) else None

    @cached_property
    def _manners(self) -> Sequence[Mapping[str, Any]]:
        """The address fields, other than the number, in the requests that probe this drive and read a parameter.

        A probe may consist of several telegrams; one that no drive answers can show whether an adapter echoes.
        """
        manners = []
        for asking in self._asking:
            with suppress(DriveCommError):
                for command in asking():
                    if isinstance(command, Ask | Tell):
                        fields = fields_of(command.message)
                        others = fields.keys() - {"address", "broadcast", "kind"}
                        manners.append({name: fields[name] for name in others})
                    if not isinstance(command, Tell):
                        break
        return manners or [{}]


def line_drives_of(drives: Iterable[DriveConfig]) -> list[LineDrive]:
    """Return the drives as partners. Raises UsageError for a drive that cannot exist."""
    dialects: dict[tuple[str, str], ProtocolOutlines] = {}
    return [LineDrive(drive, dialects) for drive in drives]
