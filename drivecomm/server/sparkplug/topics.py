"""Topics of one edge node: for sending and for commands, and the drive of a topic."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from drivecomm.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

NAMESPACE = "spBv1.0"

Kind: TypeAlias = Literal["NBIRTH", "NDEATH", "NDATA", "DBIRTH", "DDEATH", "DDATA"]
"""Message types of an edge node; those with D concern one device, which is a drive."""

_RESERVED = "+/#"
_LONGEST_ID = 200


def is_id(text: str) -> bool:
    """Whether a text can be the id of a group, edge node, device or host."""
    return 0 < len(text) <= _LONGEST_ID and not any(each in _RESERVED or not each.isprintable() for each in text)


@dataclass(frozen=True, slots=True, kw_only=True)
class SparkplugTopics:
    """Topics of an edge node in a group. host: id of the primary host application, "" without one."""

    group: str
    node: str
    host: str = ""

    def of(self, kind: Kind, device: str = "") -> str:
        """Return the topic for messages of this type."""
        return "/".join([NAMESPACE, self.group, kind, self.node, *([device] if device else [])])

    @property
    def node_commands(self) -> str:
        """Topic of commands to the edge node."""
        return f"{NAMESPACE}/{self.group}/NCMD/{self.node}"

    @property
    def device_commands(self) -> str:
        """Topic filter of commands to drives."""
        return f"{NAMESPACE}/{self.group}/DCMD/{self.node}/+"

    @property
    def host_state(self) -> str:
        """Topic of the primary host's state."""
        return f"{NAMESPACE}/STATE/{self.host}"

    def device_of(self, topic: str) -> str:
        """Return the device of a command topic, "" for another topic."""
        begin = self.device_commands.removesuffix("+")
        device = topic.removeprefix(begin)
        return device if topic.startswith(begin) and is_id(device) else ""


def id_of(text: str) -> str:
    """Return a name as an id, with _ for characters that a topic cannot contain."""
    return "".join("_" if each in _RESERVED or not each.isprintable() else each for each in text)[:_LONGEST_ID]


def device_ids(names: Mapping[str, str]) -> Mapping[str, str]:
    """Return device ids by drive. names: desired device names by drive.

    Raises UsageError if two ids are equal.
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
    """Return the alias of a metric of a drive, or of the edge node; the same after each restart.

    Otherwise a host that has not read the births of a new run yet would write to the wrong metric.
    """
    return int.from_bytes(hashlib.sha256(f"{drive}\0{metric}".encode()).digest()[:4])
