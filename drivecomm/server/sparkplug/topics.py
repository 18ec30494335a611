"""The topics of one edge node: what it sends on, what it listens to, and which drive a topic is about."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

NAMESPACE = "spBv1.0"

Kind: TypeAlias = Literal["NBIRTH", "NDEATH", "NDATA", "DBIRTH", "DDEATH", "DDATA"]
"""What an edge node sends; those with D are about one device, which is a drive."""

_RESERVED = "+/#"
_LONGEST_ID = 200


def is_id(text: str) -> bool:
    """Whether a group, an edge node, a device or a host can be called so."""
    return 0 < len(text) <= _LONGEST_ID and not any(each in _RESERVED or not each.isprintable() for each in text)


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """The topics of an edge node of a group. host: the primary host application, empty without one."""

    group: str
    node: str
    host: str = ""

    def of(self, kind: Kind, device: str = "") -> str:
        """Return where a message of this kind is sent."""
        return "/".join([NAMESPACE, self.group, kind, self.node, *([device] if device else [])])

    @property
    def node_commands(self) -> str:
        """Where hosts command the edge node."""
        return f"{NAMESPACE}/{self.group}/NCMD/{self.node}"

    @property
    def device_commands(self) -> str:
        """Where hosts command drives."""
        return f"{NAMESPACE}/{self.group}/DCMD/{self.node}/+"

    @property
    def host_state(self) -> str:
        """Where the primary host tells whether it is there."""
        return f"{NAMESPACE}/STATE/{self.host}"

    def device_of(self, topic: str) -> str:
        """Return which device a command is for; empty for a topic that is no such one."""
        begin = self.device_commands.removesuffix("+")
        device = topic.removeprefix(begin)
        return device if topic.startswith(begin) and is_id(device) else ""


def id_of(text: str) -> str:
    """Return a name as an id: with _ for what a topic has no room for."""
    return "".join("_" if each in _RESERVED or not each.isprintable() else each for each in text)[:_LONGEST_ID]


def device_ids(names: Mapping[str, str]) -> Mapping[str, str]:
    """Return what drives are called as devices, by their names. names: what they are to be called, by their names.

    Raises UsageError for two that would be called alike.
    """
    drives_by_id: dict[str, str] = {}
    for drive, name in names.items():
        device = id_of(name)
        if device in drives_by_id:
            raise UsageError(
                f"the drives {drives_by_id[device]!r} and {drive!r} would both be the Sparkplug device {device!r}; "
                f"rename one of them (a device has none of {' '.join(_RESERVED)} in its name)"
            )
        drives_by_id[device] = drive
    return {drive: device for device, drive in drives_by_id.items()}


def alias_of(drive: str, metric: str) -> int:
    """Return the number that stands for a metric of a drive, or of the edge node; the same after each restart.

    A host that has not read the births of a new run yet would otherwise write to another metric than it means.
    """
    return int.from_bytes(hashlib.sha256(f"{drive}\0{metric}".encode()).digest()[:4])
