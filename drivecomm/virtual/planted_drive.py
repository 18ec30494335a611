"""A virtual drive of a plant: its process has a clock of its own, and its answers can be made to lie."""

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


class PlantedDrive(DriveProxy):
    """A drive as its line sees it; `inner` is the protocol's own virtual drive, another one after a factory reset.

    Times are seconds of the line; the process inside goes `speed` times as fast. asked: the last request that it
    answered. requests, replies, damaged: how many it heard or sent, requests by their kind. Making one raises
    UsageError for what cannot be, with the drive's name. motor: the motor's time is that of the process. Some drives
    keep their address in a parameter.
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
        """What a master has to keep to with it."""
        return self.type.rules(self.name, drive=self, needs_pause_s=self.needs_pause_s)

    # What the line needs of it

    @property
    def name(self) -> str:
        """What the plant calls it."""
        return self.planned.name

    def time_of(self, now: float) -> float:
        """Return the time of its process."""
        return now * self._speed

    def hear(self, find: Framed | Damaged, now: float) -> VirtualReply | None:
        """Act on a request."""
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
        """Set what it holds, unless a master could then not read it. Raises UsageError."""
        # Tried on another drive: one that holds what makes no telegram would never speak again.
        self._try(self.type.new(), parameter, raw)
        self.inner.poke(parameter, raw)

    # What a plant needs beyond that

    @property
    def purpose(self) -> str:
        """Intent of the last request that it answered: read, write or command; empty if its protocol does not say."""
        tell = self.type.plugin.intent
        return "" if tell is None or self.asked is None else tell(self.asked).access or "command"

    def read(self, parameter: str, now: float) -> Reading:
        """Return what a master would read now, if nothing is stuck. Raises UsageError, DriveError or ReplyError."""
        return carry_out(self._operations.read(parameter), self.inner, self._codec, self.time_of(now))

    def become_as_new(self, now: float) -> None:
        """Take back the factory settings: of the line, and of all parameters. The motor stays the same one."""
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
            # Not to be read by anybody, whatever it holds.
            is_read = False
        try:
            spare.poke(parameter, raw)
            spare.peek(parameter, 0.0)
            if is_read:
                carry_out(self._operations.read(parameter), spare, self._codec, 0.0)
        except NoReplyError:
            # It has another address from now on.
            return
        except (DriveCommError, ValueError, TypeError, ArithmeticError) as error:
            raise ValueRefusedError(f"parameter {parameter} cannot hold {raw!r}: {error}") from error

    def stick(self, parameter: str, value: float | str) -> StuckAnswer:
        """Return what answers reads of a parameter with this value, once it is begun. Raises UsageError."""
        return StuckAnswer(self.type, self.inner, parameter, value)

    def begin(self, stuck: StuckAnswer) -> None:
        """Answer with the stuck value from now on."""
        self.end(stuck.parameter)
        self._stuck.append(stuck)

    def end(self, parameter: str) -> None:
        """Answer with what there is again."""
        self._stuck = [stuck for stuck in self._stuck if stuck.parameter != parameter]
