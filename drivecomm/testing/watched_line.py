"""A virtual line and its drives as a test sees them: what was received, what is held, what was on the line."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

from drivecomm.errors import DriveCommError, UsageError
from drivecomm.testing.recording import closest, in_words, listing, matches

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from drivecomm.plant import FaultPlan
    from drivecomm.protocol import Damaged, Motor, VirtualDrive
    from drivecomm.testing.line_trace import LineTrace
    from drivecomm.testing.recording import Received, Record
    from drivecomm.testing.sites import Site
    from drivecomm.virtual import VirtualLine, VirtualPort

WITHIN_S = 1.0
"""How long an assertion waits, in the time of the line: another program's telegram may still be on its way."""

_STEP_S = 0.005
"""How often an assertion looks, in the time of the line."""

SILENT_S = 0.1
"""How long nothing must have come, in the time of the line."""


class WatchedLine:
    """A line with virtual drives on it.

    port: what a master opens. Without listen= it is for `drivecomm.open_bus`, and the line's time is virtual; with it,
    it is a path or a URL for any program, and time is real. drives: the drives, in the order in which they were named.
    """

    def __init__(self, site: Site, drives: Mapping[str, WatchedDrive], trace: LineTrace, faults: FaultPlan) -> None:
        self.faults = faults
        self.drives = tuple(drives.values())
        self._site = site
        self._drives = dict(drives)
        self._trace = trace
        for drive in self.drives:
            drive.line = self

    @property
    def port(self) -> Any:
        """What a master opens: a path, a URL, or what `open_bus` calls to open a port."""
        port: str | Callable[[], VirtualPort] = self._site.port
        return port

    @property
    def virtual(self) -> VirtualLine:
        """The virtual line itself. Raises UsageError when it is served in real time."""
        return self._site.virtual

    def now(self) -> float:
        """Return the time on the line's clock, in seconds; it begins with 0."""
        return self._site.now()

    def advance(self, seconds: float) -> None:
        """Let time pass: at once in virtual time, by waiting in real time."""
        self._site.passes(seconds)

    def call_at(self, time_s: float, action: Callable[[], None]) -> None:
        """Do something at a time of the line's clock, in the middle of an exchange perhaps; at once if it is past.

        Raises UsageError when the line is served in real time.
        """
        self.virtual.call_at(time_s, action)

    def inject(self, data: bytes) -> None:
        """Inject foreign bytes. Raises UsageError when it is served in real time."""
        self.virtual.inject(data)

    def unplug(self) -> None:
        """Let the port fail as a port whose adapter is pulled out. Raises UsageError when it is served in real time."""
        self.virtual.broken = True

    def plug_in(self) -> None:
        """Put the adapter back. Raises UsageError when it is served in real time."""
        self.virtual.broken = False

    def drive(self, name: str) -> WatchedDrive:
        """Return the drive with this name, such as "vabus:1". Raises UsageError for one that is not on this line."""
        if name not in self._drives:
            raise UsageError(f"no {name} is on this line; there are {', '.join(self._drives) or 'no drives'}")
        return self._drives[name]

    def comes_about(self, condition: Callable[[], bool], within_s: float) -> bool:
        """Return whether this is so, or becomes so within a time of the line."""
        until = self.now() + within_s
        while not condition():
            left = until - self.now()
            if left <= 0:
                return False
            self.advance(min(_STEP_S, left))
        return True

    def trace(self) -> str:
        """Return what was on the line, decoded, one line for each telegram: the last 80 of them."""
        return self._trace.text()

    def close(self) -> None:
        """Stop serving; what was received can still be looked at. The end of the test does it anyway."""
        self._site.close()

    def __repr__(self) -> str:
        return f"<WatchedLine {', '.join(self._drives)}>"


class WatchedDrive:
    """A virtual drive on a watched line.

    name: as in "vabus:1". line: the line that it is on. Assertions wait a second of the line's time at most for what
    they want to see, or as long as `within_s` says.
    """

    line: WatchedLine

    def __init__(self, name: str, drive: VirtualDrive, record: Record, another: Callable[[], VirtualDrive]) -> None:
        self.name = name
        self._drive = drive
        self._record = record
        self._forms = HeldForms(another)

    @property
    def port(self) -> Any:
        """What a master opens to reach it: the port of its line."""
        return self.line.port

    # What it received

    @property
    def received(self) -> tuple[Received, ...]:
        """The sound telegrams that were for it, broadcasts included, in their order."""
        return self._record.received()

    @property
    def damaged(self) -> tuple[Damaged, ...]:
        """What it heard that had the shape of a telegram and was none, whoever it was for."""
        return self._record.damaged()

    def forget_received(self) -> None:
        """Forget what was received so far."""
        self._record.forget()

    def received_with(self, **fields: Any) -> tuple[Received, ...]:
        """Return those telegrams that have these fields, `kind` among them, with these values."""
        return tuple(each for each in self.received if matches(each, fields))

    def assert_received(self, *, times: int | None = None, within_s: float = WITHIN_S, **fields: Any) -> None:
        """Fail unless it received a telegram with these fields, or as many of them as `times` says.

        `drivecomm decode` shows the names of the fields, and `WatchedDrive.received` those of your telegrams.
        """
        __tracebackhide__ = True
        needed = 1 if times is None else times
        self.line.comes_about(lambda: len(self.received_with(**fields)) >= needed, within_s)
        found = self.received_with(**fields)
        if times is None and found:
            return
        if times is not None and len(found) == times:
            return
        raise AssertionError(self._reason(fields, found, times))

    def assert_nothing_received(self, *, for_s: float = SILENT_S, **fields: Any) -> None:
        """Fail if it received anything, or anything with these fields, by now and within this time of the line."""
        __tracebackhide__ = True
        if self.line.comes_about(lambda: bool(self.received_with(**fields)), for_s):
            found = self.received_with(**fields)
            raise AssertionError(f"{self.name} received {in_words(len(found), fields)}:\n{listing(found)}")

    def _reason(self, fields: Mapping[str, Any], found: Sequence[Received], times: int | None) -> str:
        wanted = "" if times is None else f", and not {times}"
        said = f"{self.name} received {in_words(len(found), fields)}{wanted}"
        received = self.received
        if found:
            return f"{said}:\n{listing(found)}"
        if not received:
            damaged = len(self.damaged)
            rest = f", but it heard {damaged} damaged ones" if damaged else ", nor anything else"
            return said + rest
        return (
            f"{said}\nclosest: {closest(received, fields)}\nall {len(received)} that it received:\n{listing(received)}"
        )

    # What it holds

    def holds(self, parameter: str) -> int | str:
        """Return what it holds, as `Reading.raw` shows it; without asking over the line.

        parameter: its address in the protocol's form, or its name in the drive's model. Raises ParameterAddressError.
        """
        return self._drive.peek(parameter, self.line.now())

    def assert_holds(self, parameter: str, raw: int | str, *, within_s: float = WITHIN_S) -> None:
        """Fail unless it holds this, or comes to hold it.

        raw: the raw number, as `poke` takes it, or what `holds` returns. Raises ParameterAddressError.
        """
        __tracebackhide__ = True
        if self.holds(parameter) == raw:
            return
        form = self._forms.of(parameter, raw)
        if not self.line.comes_about(lambda: self.holds(parameter) in (raw, form), within_s):
            shown = "" if form == raw else f" ({form!r})"
            raise AssertionError(f"{self.name} holds {self.holds(parameter)!r} in {parameter}, and not {raw!r}{shown}")

    # What happens to it

    @property
    def motor(self) -> Motor:
        """The motor that it turns; set its load or its mains voltage, and the readings follow."""
        return self._drive.motor

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set what it holds as if at its keypad. Raises ParameterAddressError."""
        self._drive.poke(parameter, raw)

    def trip(self, code: int) -> None:
        """Make it trip with this fault code."""
        self._drive.trip(code, self.line.now())

    def power_off(self) -> None:
        """Switch it off. Raises UsageError when it is served in real time."""
        self.line.virtual.power_off(self._drive)

    def power_on(self) -> None:
        """Switch it on again. Raises UsageError when it is served in real time."""
        self.line.virtual.power_on(self._drive)

    def __repr__(self) -> str:
        return f"<WatchedDrive {self.name}>"


class HeldForms:
    """What a raw number looks like in a drive.

    A VABus drive holds eight hexadecimal characters, and the raw number is 1000: so another drive of the same sort is
    set to 1000 and shows what it then holds. another: makes such a drive.
    """

    def __init__(self, another: Callable[[], VirtualDrive]) -> None:
        self._make = another
        self._known: dict[tuple[str, int | str], int | str] = {}

    def of(self, parameter: str, raw: int | str) -> int | str:
        """Return what a drive shows that holds this; the raw value itself where that cannot be tried out.

        It cannot where the drive refuses the value, and where it does not heed it: what it measures cannot be set.
        """
        if (parameter, raw) not in self._known:
            self._known[parameter, raw] = self._tried(parameter, raw)
        return self._known[parameter, raw]

    @cached_property
    def _another(self) -> VirtualDrive:
        return self._make()

    def _tried(self, parameter: str, raw: int | str) -> int | str:
        before = self._another.peek(parameter, 0.0)
        shown = self._after(parameter, raw)
        if shown is None:
            return raw
        if shown != before:
            return shown
        # It held this before, or it does not heed what it is set to.
        others = (self._after(parameter, raw + step) for step in (1, -1)) if isinstance(raw, int) else ()
        return shown if any(other not in (None, shown) for other in others) else raw

    def _after(self, parameter: str, raw: int | str) -> int | str | None:
        """Return what the other drive shows after it was set to this, None when it does not take it."""
        try:
            self._another.poke(parameter, raw)
            return self._another.peek(parameter, 0.0)
        except (DriveCommError, ValueError):
            return None
