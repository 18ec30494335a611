"""Parameters, status values and control data of a Huanyang drive in telegrams.

`PD005` is a parameter, `CFG1` a status value. `CFG0`, the set frequency, is written by function 05. Control data have
no number: `CNTR` is the place after the 256 that a telegram can name. `turns` is whether the output frequency is above
0.
"""

from __future__ import annotations

import re
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

from drivecomm.errors import ParameterAddressError
from drivecomm.profiles import Access, Dialect, RegisterConversation, RegisterPlace, control_of
from drivecomm.protocol import AddressSpace, Ask, Model, tables_beside
from drivecomm_huanyang import telegrams as fn
from drivecomm_huanyang.telegrams import Reply, Request

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivecomm.profiles import ControlStep, ControlTable, RegisterParameter, Words
    from drivecomm.protocol import Exchange
    from drivecomm_huanyang.options import HuanyangOptions

CONTROL, TURNS = RegisterPlace("", 256), RegisterPlace("s", 256)
RUN = 0x01
"""Run bit of CNTR and CNST (p. 62)."""

_ADDRESS = re.compile(r"PD([01][0-9]{2}|2[0-4][0-9]|25[0-5])|CFG([0-7])", re.ASCII)
_OWN = {"CNTR": CONTROL, "turns": TURNS}


class HuanyangDialect(Dialect):
    """The places of one Huanyang drive."""

    title = "Huanyang"
    broadcast_address = fn.BROADCAST
    requests = Request
    probe = RegisterPlace("s", 1)
    identity = {"software": "PD181", "serial": "PD183"}  # noqa: RUF012 - never changed
    refusals = {  # noqa: RUF012 - never changed
        fn.REFUSED: "it has no such parameter, or does not take this now",
        fn.CONTROL_REFUSED: "it does not take its commands from here, or not now",
    }
    codes = dict.fromkeys(("unknown", "read only", "running", "limits", "not set up"), fn.REFUSED)
    follows = ("maximum_frequency",)
    advice = "its display for a fault, which it does not report"

    def __init__(self, address: int, options: HuanyangOptions, model: Model | None) -> None:
        super().__init__(address, options, model)
        self.state_timeout_s, self.reply_delay_s = options.state_timeout_s, options.reply_delay_s

    @cached_property
    def control(self) -> ControlTable:
        """The commands of the drive, from its model; without a model those that all Huanyang drives share."""
        return control_of(type(self), self.options, self.model or _any_model())

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of an address in the manual. Raises ParameterAddressError."""
        if address in _OWN:
            return _OWN[address]
        found = _ADDRESS.fullmatch(address) if isinstance(address, str) else None
        if found is None:
            raise ParameterAddressError(
                f"{address!r} is not a parameter of a Huanyang drive; write PD005, with three digits up to PD255, or "
                "CFG0 to CFG7 for a status value"
            )
        return RegisterPlace("", int(found[1])) if found[1] else RegisterPlace("s", int(found[2]))

    def target(self, parameter: str, type: str = "") -> RegisterParameter:
        """Return the target of a read or write; places without a number are for the table [control] only."""
        if parameter in _OWN:
            raise ParameterAddressError(f"{parameter!r} is not a parameter of a Huanyang drive; use start and stop")
        return super().target(parameter, type)

    def address_at(self, place: RegisterPlace) -> str:
        """Return the address of a place as the manual prints it."""
        if place == CONTROL:
            return "CNTR"
        return f"CFG{place.start}" if place.kind else f"PD{place.start:03d}"

    def reading(self, place: RegisterPlace, _count: int, /) -> Ask:
        """Return the request for a place; the reply to a status request is longer, so an echo cannot match it."""
        if place.kind:
            item = self.probe.start if place == TURNS else place.start
            return Ask(message=self._request(fn.STATUS, 1, item, None), distinct=True)
        return Ask(message=self._request(fn.READ, 3, place.start, 0), mirrored=True)

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the request that writes a place; the drive repeats a parameter and a frequency."""
        (word,) = words
        if place == CONTROL:
            return Ask(message=self._request(fn.CONTROL, 1, None, word), nameless=True, mirrored=True)
        if place.kind:
            return Ask(message=self._request(fn.FREQUENCY, 2, None, word), mirrored=True)
        return Ask(message=self._request(fn.WRITE, 3, place.start, word), mirrored=True)

    def words(self, reply: Any, _place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the value of a reply."""
        return (reply.value or 0,)

    def refusal(self, reply: Any) -> int | None:
        """Return the function code of a refusal; None for any other reply."""
        return reply.function if reply.function in (fn.REFUSED, fn.CONTROL_REFUSED) else None

    def access_of(self, request: Any) -> Access:
        """Return the access that a request makes."""
        words = (request.value or 0,)
        if request.function == fn.CONTROL:
            return Access(place=CONTROL, words=words)
        if request.function == fn.FREQUENCY:
            return Access(place=RegisterPlace("s", 0), words=words)
        place = RegisterPlace("s" if request.function == fn.STATUS else "", request.parameter)
        return Access(place=place, words=words if request.function == fn.WRITE else None)

    def read_reply(self, request: Any, words: Sequence[int]) -> Reply:
        """Return the reply to a read; some parameters are one byte."""
        info = self.places.get(RegisterPlace("", request.parameter)) if request.function == fn.READ else None
        is_byte = info is not None and info.extra.get("bytes") == 1
        return self._reply(request, 2 if is_byte else 3, request.parameter, words[0])

    def write_reply(self, request: Any) -> Reply:
        """Return the reply to a write, which repeats the request."""
        return self._reply(request, request.length, request.parameter, request.value)

    def refusal_reply(self, request: Any, code: int) -> Reply:
        """Return the refusal of a parameter."""
        return Reply(address=self.address, function=code, length=1, parameter=request.parameter)

    def _request(self, function: int, length: int, parameter: int | None, value: int | None) -> Request:
        return Request(address=self.address, function=function, length=length, parameter=parameter, value=value)

    def _reply(self, request: Any, length: int, parameter: int | None, value: int | None) -> Reply:
        function: int = request.function
        return Reply(address=self.address, function=function, length=length, parameter=parameter, value=value)


class HuanyangConversation(RegisterConversation):
    """Requests to one drive. Until it is known to answer, no reply that may be an echo is accepted."""

    def send_request(self, ask: Ask, called: str, place: RegisterPlace | None = None) -> Exchange[Any]:
        """Send a request and return the reply; verify with a status request if the reply could be an echo.

        The check comes before a request that acts, or after an urgent one and after a first value of 0.
        """
        doubted = ask.mirrored and not self.is_there
        if doubted and ask.acts and not ask.urgent:
            yield from self._look(called)
            doubted = False
        reply = yield from super().send_request(ask, called, place)
        if doubted and (ask.urgent or reply.value == 0):
            # The reply may have been an adapter's echo. The stop has been sent; now the drive itself confirms it.
            yield from self._look(called)
            reply = yield from super().send_request(ask, called, place)
        self.is_there = True
        return reply

    def word(self, place: str) -> Exchange[int]:
        """Read one place; only the output frequency shows, without a command, whether the motor turns."""
        told = yield from super().word(place)
        return int(told > 0) if place == TURNS.name else told

    def carry(self, step: ControlStep, **how: Any) -> Exchange[Words | None]:
        """Send control data; the reply shows whether the drive runs."""
        reply = yield from self._send(RegisterPlace.named(step.place), (step.word,), "CNTR", **how)
        return None if reply is None else {TURNS.name: reply.value & RUN}

    def _look(self, called: str) -> Exchange[None]:
        yield from super().send_request(self._dialect.reading(self._dialect.probe, 1), called)


@cache
def _any_model() -> Model:
    orders = {**tables_beside(__file__, "models/hy.toml")["control"]}
    del orders["reference_hz"]
    nothing: dict[Any, Any] = {}
    return Model(
        protocol="huanyang", name="huanyang", title="", source="", parameters=nothing, faults=nothing, options=nothing,
        control=orders,
    )  # fmt: skip


def address_space(_options: HuanyangOptions, _model: Model | None) -> AddressSpace:
    """Return the parameters in the manual's list, and the status values."""
    addresses = [*(f"PD{number:03d}" for number in range(184)), *(f"CFG{number}" for number in range(8))]
    return AddressSpace(
        addresses=addresses.__iter__,
        absent=frozenset({fn.REFUSED}),
        source="PD000 to PD183, 81H for one that is not there: HY Series Inverter, User Manual, p. 18 to 24, 62",
    )
