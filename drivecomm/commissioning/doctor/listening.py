"""Observation of an idle port: noise, and an adapter that echoes its own bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivecomm.bus import scan_plan
from drivecomm.commissioning.doctor.measurements import EchoTrial, NoiseRecord
from drivecomm.protocol import Framed, Framer, installed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from drivecomm.link import Echo, Port
    from drivecomm.protocol import Direction, LineSettings

_ECHO_WAIT_S = 0.25
_ECHO_TRIALS = 3
_MOST_AT_ONCE = 4096
_WAYS: tuple[Direction, Direction] = ("request", "reply")
# These patterns fit into seven data bits, and neither noise nor a break looks like them.
_PATTERNS = (b"U*U*", b"*U*U", b"\x55\x55\x55\x55", b"j5j5", b"?Z?Z")


@dataclass(frozen=True, slots=True, kw_only=True)
class IdleObservation:
    """Observations of an idle port. echo: the echo setting given by the user.

    carries_settings: whether the line really uses the requested line settings; with raw TCP the serial server decides
    them.
    """

    paced: bool
    carries_settings: bool
    echo: Echo = "off"
    noise: Sequence[NoiseRecord] = ()
    trials: Sequence[EchoTrial] = ()

    @property
    def echoes(self) -> bool:
        """Whether the adapter echoes what it sends."""
        return self.echo == "expect" or any(trial.kind == "whole" for trial in self.trials)


def listen(
    port: Port,
    *,
    only: Iterable[str] | None = None,
    echo: Echo = "off",
    listen_s: float = 1.0,
    progress: Callable[[str, int, int], None] | None = None,
    **facts: Any,
) -> IdleObservation:
    """Listen to an open port at the settings of each protocol, and test for an echo; sends no request to a drive."""
    settings = dict.fromkeys(settings_of(only, facts).values())
    step = progress or (lambda *_: None)
    noise = []
    for each in settings:
        step(f"listening at {each}", 0, 1)
        noise.append(_listen(port, each, listen_s))
    step("looking for an echo", 0, 1)
    harmless = harmless_bytes()
    trials = [_echo_trial(port, harmless) for _ in range(_ECHO_TRIALS)] if settings and harmless else []
    carries = not any(port.configure(each) for each in settings)
    return IdleObservation(paced=port.paced, carries_settings=carries, echo=echo, noise=noise, trials=trials)


def settings_of(only: Iterable[str] | None, facts: dict[str, Any]) -> dict[str, LineSettings]:
    """Return the line settings of each protocol, by protocol name."""
    return {plugin.name: plugin.facts.override(facts).settings for plugin, _ in scan_plan(only, None)}


def harmless_bytes() -> bytes:
    """Return a few bytes in which no installed protocol finds a telegram; empty if there is no such pattern."""
    codecs = [plugin.codec(plugin.options()) for plugin in installed.working()]
    for pattern in _PATTERNS:
        finds = (find for codec in codecs for way in _WAYS for find in _finds(Framer(codec, way), pattern))
        if not any(isinstance(find, Framed) for find in finds):
            return pattern
    return b""


def _listen(port: Port, settings: LineSettings, seconds: float) -> NoiseRecord:
    port.configure(settings)
    port.take()
    began = port.now()
    data = _all_until(port, began + seconds)[0]
    telegrams: dict[str, int] = {}
    for plugin in installed.working() if data else ():
        for way in _WAYS:
            sound = sum(isinstance(find, Framed) for find in _finds(Framer(plugin.codec(plugin.options()), way), data))
            if sound > telegrams.get(plugin.name, 0):
                telegrams[plugin.name] = sound
    return NoiseRecord(settings=settings, seconds=seconds, data=data, telegrams=telegrams)


def _echo_trial(port: Port, sent: bytes) -> EchoTrial:
    port.take()
    began = port.now()
    port.write(sent)
    came, last = _all_until(port, began + _ECHO_WAIT_S)
    return EchoTrial(sent=sent, came=came, took_s=last - began if came else 0.0)


def _all_until(port: Port, until: float) -> tuple[bytes, float]:
    """Return the bytes received until a time, and the time of the last byte."""
    data, last = bytearray(), port.now()
    while port.now() < until and len(data) < _MOST_AT_ONCE:
        if came := port.read(until, 1):
            data += came
            last = port.now()
    return bytes(data), last


def _finds(framer: Framer, data: bytes) -> list[Any]:
    return [*framer.feed(data), *framer.flush()]
