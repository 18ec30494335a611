"""A plant as data: which lines there are, which drives on them, and what goes wrong when.

`drivecomm.plant.files` reads one from a file; `drivecomm.virtual.virtual_plant` makes virtual drives of it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.errors import UsageError, meant, near
from drivecomm.line import STATUS, Plan, PollItem, items_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from drivecomm.plant.script import Noise, Step
    from drivecomm.protocol import DriveConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantLine:
    """A line.

    name: what the plant calls it. listen: where a master outside connects to its virtual drives, as `parse_listen`
    takes it; empty for nowhere. port: what a master opens to reach it, for commands that are masters; where it is
    empty, `reached_at` is the other end of `listen`. listeners: clients beside the master may hear what is on it.
    echo: the master hears itself. paced: characters take their time.
    settings: line facts for all its drives, such as baudrate=19200; a drive's own options go before. noise: what
    disturbs it all the time.
    """

    name: str
    listen: str = ""
    port: str = ""
    listeners: bool = False
    echo: bool = False
    paced: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    noise: Noise | None = None

    def __post_init__(self) -> None:
        if not self.name:
            raise UsageError("a line needs a name")

    @property
    def opening(self) -> dict[str, Any]:
        """What is said of this line, as keywords of `open_bus`."""
        return {**self.settings, **({"echo": "expect"} if self.echo else {})}

    @property
    def reached_at(self) -> str:
        """What a master opens: the port, or where the line's virtual drives listen; empty when neither is known."""
        if self.port:
            return self.port
        kind, _, place = self.listen.partition(":")
        host, colon, number = place.rpartition(":")
        if kind == "pty":
            return place
        if kind not in ("tcp", "rfc2217") or number in ("", "0"):
            return ""
        scheme = "socket" if kind == "tcp" else kind
        return f"{scheme}://{host if colon and host else '127.0.0.1'}:{number}"

    def reached(self, drive: DriveConfig) -> DriveConfig:
        """Return a drive of this line as a master on its port knows it, with what is said of the line."""
        return replace(drive, line=self.reached_at, options={**self.settings, **drive.options})


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """Lines, drives, and the script of faults. Names are unique, and everything named is there.

    file: where it was read, for messages. content: what stood there, and read_s: when it was read, in seconds since
    1970; empty and None for a plant that is in no file.
    """

    lines: tuple[PlantLine, ...]
    drives: tuple[DriveConfig, ...] = ()
    script: tuple[Step, ...] = ()
    file: str = field(default="", compare=False)
    content: bytes = field(default=b"", repr=False, compare=False)
    read_s: float | None = field(default=None, repr=False, compare=False)
    _by_name: Mapping[str, DriveConfig] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.lines:
            raise UsageError("a plant needs at least one line")
        for what, names in (("lines", [each.name for each in self.lines]), ("drives", [*map(_name, self.drives)])):
            if len(set(names)) < len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise UsageError(f"two {what} are named {twice!r}; give each a name of its own")
            for name in names:
                if not name.isprintable():
                    raise UsageError(f"{name!r} has characters that no screen shows; name the {what[:-1]} without them")
        tags = Counter(tag.name for drive in self.drives for tag in drive.tags.values() if tag.name)
        for tag, number in tags.items():
            if number > 1:
                raise UsageError(f"two values have the tag {tag!r}; give each a name of its own")
        for drive in self.drives:
            _named(drive.line, self.lines, f"drive {drive.name}: there is no line")
        for number, step in enumerate(self.script, start=1):
            if line := getattr(step, "line", ""):
                _named(line, self.lines, f"fault {number}: there is no line")
            else:
                _named(getattr(step, "drive", ""), self.drives, f"fault {number}: there is no drive")
        object.__setattr__(self, "_by_name", {drive.name: drive for drive in self.drives})

    @property
    def sha256(self) -> str:
        """The hash of its file, as sha256sum prints it; empty for a plant that is in no file."""
        from hashlib import sha256

        return sha256(self.content).hexdigest() if self.content else ""

    @property
    def groups(self) -> dict[str, tuple[DriveConfig, ...]]:
        """The drives of each group, by its name; groups and drives are in the order of the file."""
        found: dict[str, list[DriveConfig]] = {}
        for drive in self.drives:
            for name in drive.groups:
                found.setdefault(name, []).append(drive)
        return {name: tuple(drives) for name, drives in found.items()}

    def group(self, name: str) -> tuple[DriveConfig, ...]:
        """Return the drives of a group, in the order of the file. Raises UsageError."""
        groups = self.groups
        if name not in groups:
            known = meant(name, groups, "it has")
            raise UsageError(f"{self._in_file}there is no group {name!r} in this plant; {known}")
        return groups[name]

    def named(self, name: str) -> tuple[DriveConfig, ...]:
        """Return the drives of the group that is called so, or the one drive that `drive` finds. Raises UsageError."""
        return self.groups.get(name) or (self.drive(name),)

    def drive(self, name: str) -> DriveConfig:
        """Return a drive by its name, or by PROTOCOL:ADDRESS where that is one drive only. Raises UsageError.

        A group is refused, also one of a single drive: who means one drive names it.
        """
        if found := self._by_name.get(name):
            return found
        if group := self.groups.get(name):
            drives = ", ".join(map(_name, group))
            raise UsageError(f"{self._in_file}{name!r} is a group, of {drives}; name one of its drives")
        if not (same := [drive for drive in self.drives if str(drive) == name]):
            raise UsageError(f"{self._in_file}there is no drive {name!r} in this plant; {self._meant(name)}")
        if len(same) > 1:
            names = " and ".join(map(_name, same))
            raise UsageError(f"{self._in_file}{name} is on several lines of this plant; name the drive: {names}")
        return same[0]

    def line(self, name: str) -> PlantLine:
        """Return a line by its name. Raises UsageError."""
        return _named(name, self.lines, f"{self._in_file}there is no line")

    def on_line(self, name: str) -> tuple[DriveConfig, ...]:
        """Return the drives of a line, in their order."""
        return tuple(drive for drive in self.drives if drive.line == name)

    def only(self, drives: Iterable[DriveConfig]) -> Plant:
        """Return the same plant with these drives only, and without its faults, which may be of others."""
        return replace(self, drives=tuple(drives), script=())

    def poll_plan(self) -> Plan:
        """Return what is polled of its drives, which are on the lines that a master opens. Raises UsageError."""
        reads: list[PollItem[Any]] = []
        for drive in self.drives:
            reads += items_of(drive.poll, self.line(drive.line).reached(drive))
        if not reads:
            raise UsageError(
                f'{self._in_file}nothing is polled; write poll = [{{ parameters = ["output_frequency"] }}] in a drive, '
                "or name drives and parameters"
            )
        return Plan(reads=tuple(reads))

    def served_plan(self, status_period_s: float) -> Plan:
        """Return what a server asks of its drives: the status of each so often, and what is polled.

        Raises UsageError for a plant without drives.
        """
        reads: list[PollItem[Any]] = []
        for drive in self.drives:
            reached = self.line(drive.line).reached(drive)
            reads.append(PollItem(drive=reached, parameter=STATUS, period_s=status_period_s, priority=1))
            reads += items_of(drive.poll, reached)
        return Plan(reads=tuple(reads))

    def _meant(self, name: str) -> str:
        """Return which drive or group was perhaps meant, and all that there are."""
        names, groups = [*map(_name, self.drives)], [*self.groups]
        if not groups:
            return meant(name, names, "it has")
        there = f"it has {', '.join(names)}, and the groups {', '.join(groups)}"
        question = near(name, [*names, *groups])
        return f"{question} {there[0].upper()}{there[1:]}" if question else there

    @property
    def _in_file(self) -> str:
        return f"{self.file}: " if self.file else ""


_Named = TypeVar("_Named", PlantLine, "DriveConfig")


def _name(each: PlantLine | DriveConfig) -> str:
    return each.name


def _named(name: str, known: Sequence[_Named], refusal: str) -> _Named:
    for each in known:
        if each.name == name:
            return each
    raise UsageError(f"{refusal} {name!r} in this plant; {meant(name, [*map(_name, known)], 'it has')}")
