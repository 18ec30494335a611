"""A virtual line and its drives as a test sees them: received telegrams, held values, and the trace of the line."""

from __future__ import annotations

import time
from functools import cached_property
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.testing.pyserial import advance, clock_of
from drivecomm.testing.recording import (
    closest_telegram_text,
    held_form,
    matches,
    telegram_count_text,
    telegram_list,
    violation_list,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from contextlib import AbstractContextManager

    from drivecomm.protocol import Damaged, Motor, VirtualDrive
    from drivecomm.testing.recording import Received, Record
    from drivecomm.virtual import LineServer, LineTrace, Violation, VirtualLine

WITHIN_S = 1.0
"""Timeout of an assertion in seconds of the line's time: another program's telegram may still be on its way."""

_STEP_S = 0.005
"""Poll interval of an assertion in seconds of the line's time."""

SILENT_S = 0.1
"""Time in seconds of the line's time for which an assertion requires silence."""


class WatchedLine:
    """A line with virtual drives on it.

    port: the port for a master to open. Without listen= it is for `drivecomm.open_bus`, and the line's time is virtual;
    with it, it is a path or a URL for any program, and time is real. drives: the drives, in the order in which they
    were named.
    """

    def __init__(
        self,
        line: VirtualLine,
        drives: Iterable[WatchedDrive],
        trace: LineTrace,
        served: ServingThread | None = None,
        address: str = "",
    ) -> None:
        self.faults = line.faults
        self.drives = tuple(drives)
        self._line = line
        self._drives = {drive.name: drive for drive in self.drives}
        self._trace = trace
        self._log = trace.violations
        self._thread = served
        self._address = address
        for drive in self.drives:
            drive.line = self

    @property
    def port(self) -> Any:
        """The port for a master to open: a path, a URL, or a callable for `open_bus`."""
        return self._address or self._line.port

    @property
    def virtual(self) -> VirtualLine:
        """The virtual line itself. Raises UsageError if the line is served in real time."""
        if self._thread is not None:
            raise UsageError(
                f"the line at {self.port} is served in real time; make it without listen= for a VirtualLine"
            )
        return self._line

    def clock(self) -> AbstractContextManager[None]:
        """Make `time.sleep` and the clocks of `time` follow this line's virtual time for the duration of a block."""
        return clock_of(self.virtual)

    def now(self) -> float:
        """Return the time on the line's clock, in seconds; the clock starts at 0."""
        return self._line.time if self._thread is None else self._thread.server.now()

    def advance(self, seconds: float) -> None:
        """Advance the time: immediately in virtual time, by waiting in real time."""
        if self._thread is None:
            advance(self._line, seconds)
        else:
            self._thread.check()
            time.sleep(seconds)

    def call_at(self, time_s: float, action: Callable[[], None]) -> None:
        """Call a function at a time of the line's clock, even during an exchange; immediately if the time is past.

        Raises UsageError if the line is served in real time.
        """
        self.virtual.call_at(time_s, action)

    def inject(self, data: bytes) -> None:
        """Inject foreign bytes. Raises UsageError if the line is served in real time."""
        self.virtual.inject(data)

    def unplug(self) -> None:
        """Make the port fail as if its adapter were pulled out.

        Raises UsageError if the line is served in real time.
        """
        self.virtual.broken = True

    def plug_in(self) -> None:
        """Plug the adapter in again. Raises UsageError if the line is served in real time."""
        self.virtual.broken = False

    def drive(self, name: str) -> WatchedDrive:
        """Return the drive with this name, such as "vabus:1". Raises UsageError if it is not on this line."""
        if name not in self._drives:
            raise UsageError(f"no {name} is on this line; there are {', '.join(self._drives) or 'no drives'}")
        return self._drives[name]

    def comes_about(self, condition: Callable[[], bool], within_s: float) -> bool:
        """Return whether a condition holds, or becomes true within this many seconds of the line's time."""
        until = self.now() + within_s
        while not condition():
            left = until - self.now()
            if left <= 0:
                return False
            self.advance(min(_STEP_S, left))
        return True

    @property
    def violations(self) -> tuple[Violation, ...]:
        """Violations of timing and line settings by the master on this line; the last 1000."""
        return self._log.found

    def forget_violations(self, drive: str) -> None:
        """Clear the violations that the master has committed with this drive so far."""
        self._log.forget(drive)

    @property
    def scripted(self) -> list[str]:
        """Telegram faults in the script of the line, each with the number of times it occurred."""
        return [str(each) for each in self._line.disturbances]

    def opened_as(self, url: str) -> None:
        """Set the URL that a master opens."""
        self._address = url

    def trace(self) -> str:
        """Return the decoded traffic of the line, one telegram a line: the last 80 of them."""
        return self._trace.text()

    def close(self) -> None:
        """Stop serving; received telegrams stay available. Called automatically at the end of the test."""
        if self._thread is not None:
            self._thread.close()

    def __repr__(self) -> str:
        return f"<WatchedLine {', '.join(self._drives)}>"


class WatchedDrive:
    """A virtual drive on a watched line.

    name: as in "vabus:1". line: the line of the drive. Assertions wait for at most one second of the line's time, or as
    long as `within_s` says.
    """

    line: WatchedLine

    def __init__(self, name: str, drive: VirtualDrive, record: Record, another: Callable[[], VirtualDrive]) -> None:
        self.name = name
        self._drive = drive
        self._record = record
        self._make_another = another

    @property
    def port(self) -> Any:
        """The port for a master to open: that of the drive's line."""
        return self.line.port

    # Received telegrams

    @property
    def received(self) -> tuple[Received, ...]:
        """Valid telegrams for this drive, including broadcasts, in order of arrival."""
        with self._record.alone:
            return tuple(self._record.received)

    @property
    def damaged(self) -> tuple[Damaged, ...]:
        """Invalid telegrams that the drive received, for any drive."""
        with self._record.alone:
            return tuple(self._record.damaged)

    def forget_received(self) -> None:
        """Clear the telegrams received so far, valid and invalid."""
        with self._record.alone:
            self._record.received.clear()
            self._record.damaged.clear()
        self.line.forget_violations(self.name)

    def received_with(self, **fields: Any) -> tuple[Received, ...]:
        """Return the telegrams that have these fields, including `kind`, with these values."""
        return tuple(each for each in self.received if matches(each, fields))

    def assert_received(self, *, times: int | None = None, within_s: float = WITHIN_S, **fields: Any) -> None:
        """Fail unless the drive received a telegram with these fields, or exactly `times` of them.

        `drivecomm decode` shows the names of the fields, and `WatchedDrive.received` those of your telegrams.
        """
        __tracebackhide__ = True
        needed = 1 if times is None else times
        self.line.comes_about(lambda: len(self.received_with(**fields)) >= needed, within_s)
        found = self.received_with(**fields)
        if not found if times is None else len(found) != times:
            raise AssertionError(self._reason(fields, found, times))

    def assert_nothing_received(self, *, for_s: float = SILENT_S, **fields: Any) -> None:
        """Fail if the drive has received any telegram with these fields, or receives one within `for_s` seconds.

        Without fields, any telegram fails. The time is that of the line.
        """
        __tracebackhide__ = True
        if self.line.comes_about(lambda: bool(self.received_with(**fields)), for_s):
            found = self.received_with(**fields)
            raise AssertionError(
                f"{self.name} received {telegram_count_text(len(found), fields)}:\n{telegram_list(found)}"
            )

    # Behaviour of the master

    @property
    def violations(self) -> tuple[Violation, ...]:
        """Violations of timing and line settings by the master with this drive, including notes; see `Violation`."""
        return tuple(each for each in self.line.violations if each.drive == self.name)

    def assert_timing(self, *, for_s: float = SILENT_S) -> None:
        """Fail if the master has violated a required time, or does so within `for_s` seconds of the line's time.

        Times that are only defaults of drivecomm are notes among the `violations`, and never fail.
        """
        __tracebackhide__ = True
        self._assert_none(lambda each: each.rule != "line settings" and each.demanded, for_s)

    def assert_settings(self, *, for_s: float = SILENT_S) -> None:
        """Fail if the master has used line settings other than the drive's, or does so within `for_s` seconds.

        A pseudo-terminal shows speed and stop bits; RFC 2217 and virtual time show data bits and parity as well. The
        time is that of the line. Raises UsageError over plain TCP, which carries no line settings.
        """
        __tracebackhide__ = True
        if str(self.port).startswith("socket:"):
            raise UsageError(
                f"plain TCP does not show what line settings the master of {self.name} uses; "
                'make the line with listen="rfc2217", or "pty" for speed and stop bits'
            )
        self._assert_none(lambda each: each.rule == "line settings", for_s)

    def _assert_none(self, condition: Callable[[Violation], bool], for_s: float) -> None:
        __tracebackhide__ = True
        if self.line.comes_about(lambda: any(map(condition, self.violations)), for_s):
            found = [each for each in self.violations if condition(each)]
            raise AssertionError(f"{self.name}: its master is at fault\n{violation_list(found)}")

    def _reason(self, fields: Mapping[str, Any], found: Sequence[Received], times: int | None) -> str:
        wanted = "" if times is None else f", and not {times}"
        said = f"{self.name} received {telegram_count_text(len(found), fields)}{wanted}"
        received = self.received
        if found:
            return f"{said}:\n{telegram_list(found)}"
        if received:
            everything = f"all {len(received)} that it received:\n{telegram_list(received)}"
            return f"{said}\nclosest: {closest_telegram_text(received, fields)}\n{everything}"
        damaged = len(self.damaged)
        return said + (f", but it heard {damaged} damaged ones" if damaged else ", nor anything else")

    # Held values

    def holds(self, parameter: str) -> int | str:
        """Return a parameter's value as `Reading.raw` shows it, without a telegram on the line.

        parameter: its address in the protocol's form, or its name in the drive's model. Raises ParameterAddressError.
        """
        return self._drive.peek(parameter, self.line.now())

    def assert_holds(self, parameter: str, raw: int | str, *, within_s: float = WITHIN_S) -> None:
        """Fail unless a parameter has this raw value, or takes it within `within_s` seconds of the line's time.

        raw: the raw number, as `poke` takes it, or a return value of `holds`. Raises ParameterAddressError.
        """
        __tracebackhide__ = True
        if self.holds(parameter) == raw:
            return
        form = held_form(self._another, parameter, raw)
        if not self.line.comes_about(lambda: self.holds(parameter) in (raw, form), within_s):
            shown = "" if form == raw else f" ({form!r})"
            raise AssertionError(f"{self.name} holds {self.holds(parameter)!r} in {parameter}, and not {raw!r}{shown}")

    @cached_property
    def _another(self) -> VirtualDrive:
        return self._make_another()

    # Events at the drive

    @property
    def motor(self) -> Motor:
        """The drive's motor; set its load or its mains voltage to change the readings."""
        return self._drive.motor

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set a parameter as if at the drive's keypad. Raises ParameterAddressError."""
        self._drive.poke(parameter, raw)

    def trip(self, code: int) -> None:
        """Trip the drive with this fault code."""
        self._drive.trip(code, self.line.now())

    def power_off(self) -> None:
        """Switch the drive off. Raises UsageError if the line is served in real time."""
        self.line.virtual.power_off(self._drive)

    def power_on(self) -> None:
        """Switch the drive on again. Raises UsageError if the line is served in real time."""
        self.line.virtual.power_on(self._drive)

    def __repr__(self) -> str:
        return f"<WatchedDrive {self.name}>"


class ServingThread:
    """Thread that serves lines from its creation until it is closed. Raises PortError if a port cannot be opened."""

    def __init__(self, server: LineServer) -> None:
        self.server = server
        self._stop = Event()
        self._error: BaseException | None = None
        server.__enter__()
        self._thread = Thread(target=self._serve, name="drivecomm virtual line", daemon=True)
        self._thread.start()

    def check(self) -> None:
        """Raise RuntimeError if serving has ended with an error."""
        if self._error is not None:
            raise RuntimeError(f"the virtual line is no longer served: {self._error!r}") from self._error

    def close(self) -> None:
        """Stop the thread and close the ports; raise the error that ended serving, if any. May be called again."""
        self._stop.set()
        self._thread.join()
        self.server.__exit__(None, None, None)
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _serve(self) -> None:
        try:
            self.server.run(self._stop)
        except BaseException as error:  # noqa: BLE001 - raised in the test's thread
            self._error = error
