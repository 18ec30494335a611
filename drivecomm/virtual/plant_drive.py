"""A virtual drive of a plant, whose process has its own clock and whose answers can be falsified."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.errors import DriveCommError, DriveError, NoReplyError, ValueRefusedError
from drivecomm.protocol import Framed, is_for
from drivecomm.virtual.drive_proxy import DriveProxy
from drivecomm.virtual.drives import carry_out, drive_type
from drivecomm.virtual.station import Overhears
from drivecomm.virtual.stuck_answer import StuckAnswer

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any

    from drivecomm.protocol import Damaged, DriveConfig, Message, Model, Reading, VirtualDrive, VirtualReply
    from drivecomm.virtual.line_rules import LineRules


class PlantDrive(DriveProxy):
    """A drive as its line sees it. `inner` is the protocol's virtual drive, which a factory reset replaces.

    Times are seconds of the line; the process inside runs `speed` times as fast, and so does the time of `motor`.
    asked: the last request that the drive answered. requests: number of requests to it, by kind. replies: number of its
    replies. damaged: number of damaged telegrams that it heard. The address may change, because some drives keep it in
    a parameter. Raises UsageError for invalid settings, with the drive's name.
    """

    def __init__(
        self,
        planned: DriveConfig,
        model: Model,
        *,
        for_all: Mapping[str, Any],
        speed: float = 1.0,
        around: Callable[[str, VirtualDrive], VirtualDrive] = lambda _, drive: drive,
    ) -> None:
        options = {name: value for name, value in planned.options.items() if name != "model"}
        self.planned = planned
        self.needs_pause_s = planned.needs_pause_s
        self.type = drive_type(planned.protocol, planned.address, model=model, options=options, for_all=for_all)
        self.asked: Message | None = None
        self.requests: Counter[str] = Counter()
        self.replies = self.damaged = 0
        self._around = around
        super().__init__(around(planned.name, self.type.new()))
        planned.fit(self.inner.motor)
        self._speed = speed
        self._stuck: list[StuckAnswer] = []
        self.overhears = isinstance(self.inner, Overhears)
        for_all_drives = frozenset({self.type.plugin.broadcast_address})
        self.shared_addresses = getattr(self.inner, "shared_addresses", for_all_drives)
        self._codec = self.type.plugin.codec(self.type.options)
        self._operations = self.type.plugin.operations(planned.address, self.type.options, self.type.model)
        spare = self.type.new() if planned.values else self.inner
        for parameter, raw in planned.values.items():
            self._try(spare, parameter, raw)
            self.inner.poke(parameter, raw)

    @property
    def rules(self) -> LineRules:
        """The rules that a master must keep with this drive."""
        return self.type.rules(self.name, drive=self, needs_pause_s=self.needs_pause_s)

    # Interface to the line

    @property
    def name(self) -> str:
        """The name of the drive in the plant."""
        return self.planned.name

    def time_of(self, now: float) -> float:
        """Return the time of the process."""
        return now * self._speed

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Count a telegram and deliver it to the drive; return its reply, None for silence."""
        if not isinstance(find, Framed):
            self.damaged += 1
        elif is_for(self.type.plugin, self.inner, find.message):
            self.requests[find.message.kind] += 1
        reply = self.inner.hear(find, self.time_of(now))
        if reply is None:
            return None
        self.replies += 1
        if self.planned.reply_delay_s is not None:
            reply = replace(reply, delay_s=self.planned.reply_delay_s)
        self.asked = find.message if isinstance(find, Framed) else None
        for stuck in self._stuck:
            reply = stuck.instead_of(reply, self.asked)
        return reply

    def poke(self, parameter: str, raw: int | str) -> None:
        """Set a parameter, unless a master could then no longer read it. Raises UsageError."""
        # Try the value on a spare drive: a value that fits no telegram would silence the drive for ever.
        self._try(self.type.new(), parameter, raw)
        self.inner.poke(parameter, raw)

    # Interface to the plant

    @property
    def purpose(self) -> str:
        """Intent of the last answered request: read, write or command; empty if the protocol defines none."""
        tell = self.type.plugin.intent
        return "" if tell is None or self.asked is None else tell(self.asked).access or "command"

    def read(self, parameter: str, now: float) -> Reading:
        """Return the reading that a master would get now if no answer were stuck.

        Raises UsageError, DriveError or ReplyError.
        """
        return carry_out(self._operations.read(parameter), self.inner, self._codec, self.time_of(now))

    def restore_factory_settings(self, now: float) -> None:
        """Restore the factory settings of the line and of all parameters. The motor data of the plant still apply."""
        fresh = self._around(self.name, self.type.new(self.type.factory_facts))
        self.planned.fit(fresh.motor)
        fresh.motor.advance(self.time_of(now))
        self.inner = fresh

    def _try(self, spare: VirtualDrive, parameter: str, raw: int | str) -> None:
        spare.peek(parameter, 0.0)
        try:
            carry_out(self._operations.read(parameter), spare, self._codec, 0.0)
            is_read = True
        except (DriveError, NoReplyError):
            # No master can read this parameter, whatever its value.
            is_read = False
        try:
            spare.poke(parameter, raw)
            spare.peek(parameter, 0.0)
            if is_read:
                carry_out(self._operations.read(parameter), spare, self._codec, 0.0)
        except NoReplyError:
            # The value has changed the address of the drive, so it no longer answers at the old one.
            return
        except (DriveCommError, ValueError, TypeError, ArithmeticError) as error:
            raise ValueRefusedError(f"parameter {parameter} cannot hold {raw!r}: {error}") from error

    def stick(self, parameter: str, value: float | str) -> StuckAnswer:
        """Return an object that answers reads of a parameter with this value once `begin` is called.

        Raises UsageError.
        """
        return StuckAnswer(self.type, self.inner, parameter, value)

    def begin(self, stuck: StuckAnswer) -> None:
        """Answer reads of the parameter with the stuck value from now on."""
        self.end(stuck.parameter)
        self._stuck.append(stuck)

    def end(self, parameter: str) -> None:
        """Answer reads of the parameter with its real value again."""
        self._stuck = [stuck for stuck in self._stuck if stuck.parameter != parameter]
