"""State of one line: its time and settings, when it is free, and what was last sent and heard on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.link.echo import Echo, EchoFilter
from drivecomm.link.health import LONGEST_PAUSE_S, TuningWatch, UsualDelays
from drivecomm.link.peer import DriveRecord, TraceEvent
from drivecomm.link.port import Configure, LinkSteps, Receive, Send, Transaction, Wait

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.link.other_masters import OtherMasters
    from drivecomm.link.peer import Peer, What
    from drivecomm.protocol import Ask, LineSettings, Message


class LineState:
    """State of one line, shared by all its drives.

    now: time of the last effect. settings: settings of the port; None if unknown. free_at: time when the next telegram
    may be sent. sent_at: time when the last request is completely on the wire. heard_at: time of the last received
    bytes. unclean: whether an exchange was cut off, so that the line must be drained first. delays: usual delays of the
    replies. tuning: monitor of the tuned turnarounds. probed: the last drive that was probed in vain for less than its
    whole reply time. talk: filled in for each request on the short path. told: the last telegram without a reply.
    echoes: whether a sent telegram came back although the adapter should have no echo. others: knowledge about other
    masters. doubt: why the result of the present exchange is uncertain; empty if it is certain. records: records of
    the drives of the line, by name. newcomers: initial record of the next new drive of a protocol whose late replies
    name no drive. trace, away: see `Link`.
    """

    def __init__(  # noqa: PLR0917 - made in one place
        self,
        trace: Callable[[TraceEvent], None] | None,
        away: Callable[[str], None] | None,
        echo: Echo,
        guard_s: float,
        others: OtherMasters,
        records: dict[str, DriveRecord],
    ) -> None:
        self.trace = trace
        self.away = away or _nobody
        self.echo = EchoFilter(echo)
        self.now = 0.0
        self.settings: LineSettings | None = None
        self.free_at = 0.0
        self.sent_at = 0.0
        self.heard_at = float("-inf")
        self.unclean = False
        self.delays = UsualDelays()
        self.tuning = TuningWatch()
        self.probed: DriveRecord | None = None
        self.talk = Transaction()
        self.told = b""
        self.echoes = False
        self.others = others
        self.records = records
        self.newcomers: dict[str, DriveRecord] = {}
        self.doubt = ""
        self._guard_s = guard_s
        self._patient_at = float("-inf")

    def reopened(self) -> None:
        """Forget the state of the port before it was reopened, except its echo: most likely the adapter is the same."""
        self.settings = None
        self.unclean = False

    def note(self, peer: Peer, what: What, data: bytes = b"", message: Message | None = None, detail: str = "") -> None:
        """Call the trace function, if there is one."""
        if self.trace is not None:
            self.trace(TraceEvent(time=self.now, what=what, drive=peer.name, data=data, message=message, detail=detail))

    def send(
        self,
        peer: Peer,
        record: DriveRecord,
        data: bytes,
        message: Message,
        unasked: bytes = b"",
        *,
        mirrored: bool = False,
    ) -> LinkSteps[None]:
        """Send a telegram as soon as the line is free and quiet.

        unasked: bytes received since the line became free. mirrored: whether the reply may equal the telegram.
        """
        came = unasked
        if not came:
            if not self.is_set_for(peer):
                yield from self.settle(peer)
            if self.now < self.free_at:
                self.now = (yield Wait(self.free_at)).time
            self.now, came, _ = yield Receive(self.now)
        if came and self.echo.looking:
            # This may be the echo of a telegram that has no reply.
            came = self.without_echo(peer, record, came)
        if came and self.told and self.told in came:
            # A telegram without a reply came back, so there is an echo after all.
            self.echoes = True
        if came:
            # Another telegram (a repeated or late reply) is under way: wait for its end before sending.
            self.heard_at = self.now
            self._unasked(peer, record, came, "unasked")
            yield from self.drain(peer, record)
        self.judge(peer)
        # Reserve the line until the telegram is on the wire, even if sending fails.
        self.free_at = self.sent_at = self.now + len(data) * peer.character_s
        self.now = (yield Send(data)).time
        if self.echo.looking:
            self.echo.sent(data, mirrored=mirrored)
        if self.trace is not None:
            self.note(peer, "sent", data, message)

    def settle(self, peer: Peer) -> LinkSteps[None]:
        """Set the port to the drive's line settings."""
        if self.now < self.free_at:
            self.now = (yield Wait(self.free_at)).time
        # After an interruption here the settings of the port are unknown.
        before, self.settings = self.settings, None
        arrival = yield Configure(peer.settings)
        self.now = arrival.time
        if arrival.note:
            self.note(peer, "note", detail=arrival.note)
        if before is not None:
            self.free_at = max(self.free_at, self.now + self._guard_s)
        self.settings = peer.settings

    def possible_repliers(self, peer: Peer, record: DriveRecord, ask: Ask) -> list[DriveRecord]:
        """Return the records of all drives to which a late reply to this request could be attributed.

        If the reply names no drive, these include the record for drives that are not known yet.
        """
        if not ask.anonymous:
            return [record]
        newcomer = self.newcomers.setdefault(peer.protocol, DriveRecord(peer.settings))
        known = self.records.copy().items()
        return [*(each for name, each in known if name.partition(":")[0] == peer.protocol), newcomer]

    def is_plain_for(self, peer: Peer) -> bool:
        """Return whether an exchange with this drive can take the short path, because nothing unusual is going on.

        Traced exchanges, and those through an adapter that may echo, take the long path, which reports more.
        """
        if self.unclean or self.trace is not None or self.echo.looking or self.others.passed_by:
            return False
        return self.settings is peer.settings or self.is_set_for(peer)

    def is_set_for(self, peer: Peer) -> bool:
        """Return whether the port has the drive's line settings."""
        return self.settings is peer.settings or self.settings == peer.settings

    def drain(self, peer: Peer, record: DriveRecord) -> LinkSteps[None]:
        """Read until the line has been quiet for the drive's gap, at most for one reply time."""
        gap = peer.gap_s
        limit = self.now + max(peer.facts.timing.reply_timeout_s, gap)
        while (quiet_at := min(limit, self.heard_at + gap)) > self.now:
            self.now, came, _ = yield Receive(quiet_at)
            if came:
                self.heard_at = self.now
                record.count["drained bytes"] += len(came)
                self.others.pass_by(came)
                self.note(peer, "noise", came, detail="drained")
                self.heard_out_of_turn()

    def drop_early_bytes(self, peer: Peer, record: DriveRecord, came: bytes, *, is_echo: bool) -> bool:
        """Drop bytes that came while the request was being sent; return whether they are its unexpected echo."""
        if self.echo.looking:
            rest = self.without_echo(peer, record, came)
            self.echo.excused = max(0, self.echo.excused - len(came))
            if not rest:
                return False
            came = rest
        if is_echo:
            record.count["echo bytes"] += len(came)
            self.note(peer, "echo", came)
            return True
        self._unasked(peer, record, came, "arrived before the request was sent")
        return False

    def without_echo(self, peer: Peer, record: DriveRecord, came: bytes) -> bytes:
        """Return the received bytes without the echo.

        If no bytes came, return those that were held back as the beginning of an echo.
        """
        echo, rest = self.echo.take(came) if came else (self.echo.give_up(), b"")
        if echo:
            record.count["echo bytes"] += len(echo)
            self.note(peer, "echo", echo)
        return rest

    def request_failed(self, peer: Peer, record: DriveRecord) -> None:
        """Record that a drive did not answer soundly; too many such errors end all tuned turnarounds."""
        if self.tuning.failed(peer.name, record.count["requests"], record.count["replies"]):
            record.count["tunings given up"] += 1
            self.note(peer, "note", detail="errors rose; the usual turnaround is used again for all drives of the line")

    def heard_out_of_turn(self) -> None:
        """Give the last probed drive more time at its next probe, because late bytes may be its reply."""
        if self.probed is not None and self.now >= self._patient_at:
            self.probed.health.heard_late()
            # Noise must not make every probe a long one.
            self._patient_at = self.now + LONGEST_PAUSE_S
        self.probed = None

    def judge(self, peer: Peer, *ours: bytes) -> None:
        """Check the bytes that passed by for signs of another master. ours: the request just sent, if any."""
        self.others.judge(peer, (self.told, *ours), self.now)

    def _unasked(self, peer: Peer, record: DriveRecord, came: bytes, detail: str) -> None:
        self.others.pass_by(came)
        record.count["unasked bytes"] += len(came)
        self.note(peer, "noise", came, detail=detail)
        self.heard_out_of_turn()


def _nobody(_drive: str) -> None:
    pass
