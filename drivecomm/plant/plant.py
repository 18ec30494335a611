"""A plant as data: its lines, the drives on them, and a script of faults with their times.

`drivecomm.plant.files` reads one from a file; `drivecomm.virtual.virtual_plant` makes virtual drives of it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

from drivecomm.errors import UsageError, did_you_mean, suggestion
from drivecomm.line import STATUS, PollItem, PollPlan, items_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from drivecomm.plant.script import LineNoise, ScriptStep
    from drivecomm.protocol import DriveConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantLine:
    """One line of a plant.

    name: name in the plant. listen: where an external master connects to the virtual drives of the line, in the form of
    `parse_listen`; empty for nowhere. port: the port that a master opens, for commands that act as masters; if it is
    empty, `reached_at` is the other end of `listen`. listeners: whether further clients may listen to the line beside
    the master. echo: whether the master receives its own characters. paced: whether characters take their time.

    settings: line facts for all drives of the line, such as baudrate=19200; options of a drive override them. noise:
    permanent random disturbance.
    """

    name: str
    listen: str = ""
    port: str = ""
    listeners: bool = False
    echo: bool = False
    paced: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    noise: LineNoise | None = None

    def __post_init__(self) -> None:
        if not self.name:
            raise UsageError("a line needs a name")

    @property
    def opening(self) -> dict[str, Any]:
        """Settings of this line, as keywords of `open_bus`."""
        return {**self.settings, **({"echo": "expect"} if self.echo else {})}

    @property
    def reached_at(self) -> str:
        """Port that a master opens, or the address at which the virtual drives listen; empty if neither is known."""
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
        """Return a drive of this line with the line's port and settings, as a master needs it."""
        return replace(drive, line=self.reached_at, options={**self.settings, **drive.options})


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """Lines, drives, and the script of faults. Names are unique, and every name that is used exists.

    file: path of the plant file, for messages. content: bytes of the file. read_s: time of reading, in seconds since
    1970. content is empty and read_s is None for a plant without a file.
    """

    lines: tuple[PlantLine, ...]
    drives: tuple[DriveConfig, ...] = ()
    script: tuple[ScriptStep, ...] = ()
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
                    raise UsageError(f"{name!r} has unprintable characters; name the {what[:-1]} without them")
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
        """SHA-256 hash of the file, as sha256sum prints it; empty for a plant without a file."""
        from hashlib import sha256

        return sha256(self.content).hexdigest() if self.content else ""

    @property
    def groups(self) -> dict[str, tuple[DriveConfig, ...]]:
        """Drives of each group, by the name of the group; groups and drives are in the order of the file."""
        found: dict[str, list[DriveConfig]] = {}
        for drive in self.drives:
            for name in drive.groups:
                found.setdefault(name, []).append(drive)
        return {name: tuple(drives) for name, drives in found.items()}

    def group(self, name: str) -> tuple[DriveConfig, ...]:
        """Return the drives of a group, in the order of the file. Raises UsageError."""
        groups = self.groups
        if name not in groups:
            known = suggestion(name, groups, "it has")
            raise UsageError(f"{self._in_file}there is no group {name!r} in this plant; {known}")
        return groups[name]

    def named(self, name: str) -> tuple[DriveConfig, ...]:
        """Return the drives of the group with this name, or the single drive that `drive` finds. Raises UsageError."""
        return self.groups.get(name) or (self.drive(name),)

    def drive(self, name: str) -> DriveConfig:
        """Return a drive by its name, or by PROTOCOL:ADDRESS if only one drive has it. Raises UsageError.

        The name of a group is refused, even if the group has a single drive, so that a command for one drive names that
        drive.
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
        """Return the same plant with only these drives, and without its faults, which may concern other drives."""
        return replace(self, drives=tuple(drives), script=())

    def poll_plan(self) -> PollPlan:
        """Return the poll plan of the drives, for a master. Raises UsageError if nothing is polled."""
        reads: list[PollItem[Any]] = []
        for drive in self.drives:
            reads += items_of(drive.poll, self.line(drive.line).reached(drive))
        if not reads:
            raise UsageError(
                f'{self._in_file}nothing is polled; write poll = [{{ parameters = ["output_frequency"] }}] in a drive, '
                "or name drives and parameters"
            )
        return PollPlan(reads=tuple(reads))

    def served_plan(self, status_period_s: float) -> PollPlan:
        """Return the poll plan of a server: the status of each drive once per period, and the polled values.

        Raises UsageError for a plant without drives.
        """
        reads: list[PollItem[Any]] = []
        for drive in self.drives:
            reached = self.line(drive.line).reached(drive)
            reads.append(PollItem(drive=reached, parameter=STATUS, period_s=status_period_s, priority=1))
            reads += items_of(drive.poll, reached)
        return PollPlan(reads=tuple(reads))

    def _meant(self, name: str) -> str:
        """Return a suggestion for a mistyped name, and the names of all drives and groups."""
        names, groups = [*map(_name, self.drives)], [*self.groups]
        if not groups:
            return suggestion(name, names, "it has")
        there = f"it has {', '.join(names)}, and the groups {', '.join(groups)}"
        question = did_you_mean(name, [*names, *groups])
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
    raise UsageError(f"{refusal} {name!r} in this plant; {suggestion(name, [*map(_name, known)], 'it has')}")
