"""Exchanges in real time: the same vectors through real ports, with every runner that waits."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.testing.calls import Line, call_awaited, call_blocking
from drivecomm.testing.checking import CheckFailure, check
from drivecomm.testing.live_line import live_partner

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivecomm.protocol import Protocol
    from drivecomm.testing.checks.exchanges import Face
    from drivecomm.testing.exchange_vectors import ExchangeVector
    from drivecomm.testing.live_line import PortKind

# However busy the machine is, a reply that is sent at once comes within this time.
_PATIENCE_S = 3.0
_LONGEST_S = 0.3


@check("live", "terminal")
def goes_as_written_over_a_terminal(plugin: Protocol, vector: ExchangeVector) -> None:
    """Blocking, over a pseudo-terminal, the conversation goes as it is written."""
    _play("pty", call_blocking, plugin, vector)


@check("live", "terminal-awaited")
def goes_as_written_over_a_terminal_awaited(plugin: Protocol, vector: ExchangeVector) -> None:
    """In an event loop that watches a pseudo-terminal, the conversation goes as it is written."""
    _play("pty", call_awaited, plugin, vector)


@check("live", "socket")
def goes_as_written_over_a_socket(plugin: Protocol, vector: ExchangeVector) -> None:
    """Blocking, over TCP, the conversation goes as it is written."""
    _play("tcp", call_blocking, plugin, vector)


@check("live", "thread")
def goes_as_written_in_a_thread(plugin: Protocol, vector: ExchangeVector) -> None:
    """In an event loop that leaves the waiting to a thread, over RFC 2217, the conversation goes as it is written."""
    _play("rfc2217", call_awaited, plugin, vector)


def sample(vectors: Iterable[ExchangeVector], number: int) -> list[ExchangeVector]:
    """Return so many vectors that take next to no time, evenly taken from all of them."""
    quick = [vector for vector in vectors if vector.steps and _is_quick(vector)]
    step = max(1, len(quick) // number) if number else 1
    return quick[::step][:number]


def _is_quick(vector: ExchangeVector) -> bool:
    """Whether it is over soon, and does not depend on how long something takes."""
    actions = {step.action for step in vector.steps}
    if actions & {"silence", "garbage"} or any(call.expected.error for call in vector.calls):
        return False
    return sum(step.seconds or 0.0 for step in vector.steps) < _LONGEST_S


def play(kind: PortKind, face: Face, plugin: Protocol, vector: ExchangeVector) -> None:
    """Play a vector through a port of this kind. Raises CheckFailure."""
    with live_partner(kind, vector) as partner:
        try:
            face(plugin, vector, Line(partner.address, partner.begin))
        except CheckFailure:
            # That a call fails is mostly the consequence of something wrong that was sent.
            partner.blame()
            raise
        partner.end()


def _play(kind: PortKind, face: Face, plugin: Protocol, vector: ExchangeVector) -> None:
    patience = {"reply_timeout_s": _PATIENCE_S, "gap_s": _PATIENCE_S}
    play(kind, face, plugin, replace(vector, options={**vector.options, **patience}))
