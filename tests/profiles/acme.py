"""Acme drives: an invented protocol that uses every feature of register drives, on a virtual line.

>  address  kind  register  data data  XOR        and < for a reply

kind: R read, W write, P choose a page; in a reply also N, a refusal with a code. Registers from 100 on are the same on
each page, the others have ten on a page. Register 120 takes commands, 121 resets without a reply, 122 shows the status.
"""

from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import drivecomm
from drivecomm.errors import ParameterAddressError
from drivecomm.models import read_model
from drivecomm.profiles import Access, Dialect, RegisterPlace, RegisterRefusal, register_protocol
from drivecomm.protocol import Ask, LineFacts, LineSettings, Timing, installed
from drivecomm.protocol.schema import CheckCharacters, Form, choice, constant, message_of, unsigned, whole, xor_byte
from drivecomm.virtual import VirtualLine, virtual_drive

SUM_ERROR, BUSY, UNKNOWN, LIMITS, MODE = 1, 2, 3, 4, 5
RESET = 121


@dataclass(frozen=True, slots=True, kw_only=True)
class AcmeMessage:
    """A message of the Acme protocol."""

    kind: str
    address: int
    register: int
    data: int = 0


class Request(AcmeMessage):
    """A request of the master."""


class Reply(AcmeMessage):
    """A reply of a drive."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """A refusal by a drive."""

    kind: str
    address: int
    register: int
    error: int


def _form(message, start, kinds, last="data"):
    return Form(
        message,
        constant(start, start.decode()),
        "address" / whole(1, range(32), "address; 0: all drives"),
        "kind" / choice(kinds, "what"),
        "register" / unsigned(1, "register"),
        last / unsigned(2, "value, or why not"),
        CheckCharacters(1, 0, xor_byte, meaning="XOR"),
    )


FORMS = {
    "request": _form(Request, b">", {b"R": "read", b"W": "write", b"P": "page"}),
    "reply": _form(Reply, b"<", {b"R": "read", b"W": "write", b"P": "page"}),
    "refusal": _form(Refusal, b"<", {b"N": "refused"}, "error"),
}


class AcmeCodec:
    """Telegrams of seven bytes, followed by `end` carriage returns."""

    def __init__(self, end=0):
        self.end = bytes([0x0D]) * end

    def measure(self, head, direction):
        return 7 + len(self.end) if not head or head[:1] == (b">" if direction == "request" else b"<") else 0

    def decode(self, data, direction):
        return FORMS["refusal" if data[:3:2] == b"<N" else direction].parse(
            data.removesuffix(self.end) if self.end else data
        )

    def encode(self, message):
        return FORMS[type(message).__name__.lower()].build(message) + self.end


class AcmeDialect(Dialect):
    """The dialect of Acme drives; registers of a page have the place kind p."""

    title = "Acme"
    broadcast_address = 0
    probe, identity = RegisterPlace("", 122), {"software": "19"}
    repeats = {"": ("register",), "write": ("data",)}  # noqa: RUF012 - never mutated
    refusals = {SUM_ERROR: "wrong sum", BUSY: "busy", UNKNOWN: "no such register", LIMITS: "limits", MODE: "mode"}  # noqa: RUF012
    codes = {"unknown": UNKNOWN, "read only": UNKNOWN, "running": MODE, "limits": LIMITS, "not set up": MODE}  # noqa: RUF012
    busy = (BUSY,)
    feeds_all = True

    def __init__(self, address, options, model):
        super().__init__(address, options, model)
        self._page = 0

    def forget(self):
        self._page = 0

    def control_defaults(self):
        return {"plain_write": self.options.writes}

    def place_of(self, address):
        name, _, part = address.partition(".")
        if not name.isdigit() or int(name) > 255:
            raise ParameterAddressError(f"{address!r} is no register of an Acme drive; they are 0 to 255")
        return RegisterPlace("" if int(name) >= 100 else "p", int(name), part)

    def preparing(self, place):
        page = Request(kind="page", address=self.address, register=place.start // 10)
        return Ask(message=page) if place.kind else None

    def reading(self, place, _count):
        return Ask(message=Request(kind="read", address=self.address, register=_in_page(place)))

    def writing(self, place, words):
        request = Request(kind="write", address=self.address, register=_in_page(place), data=words[0])
        return Ask(message=request)

    def silence_s(self, request):
        return 2.0 if request.kind == "write" and request.register == RESET else 0

    def words(self, reply, _place):
        return (reply.data,)

    def refusal(self, reply):
        return reply.error if reply.kind == "refused" else None

    def reply_kinds_of(self, request):
        return request.kind, "refused"

    def verbs(self, drive):
        return {"jog": lambda number: drive.write(RegisterPlace("", 130), (number,), "jog", attempts=1)}

    def access_of(self, request):
        if request.kind == "page":
            self._page = request.register
            return None
        number = request.register
        if number >= 200:
            raise RegisterRefusal("unknown")
        place = RegisterPlace("", number) if number >= 100 else RegisterPlace("p", 10 * self._page + number)
        return Access(place=place, words=(request.data,) if request.kind == "write" else None)

    def read_reply(self, request, words):
        return Reply(kind="read", address=request.address, register=request.register, data=words[0])

    def write_reply(self, request):
        return Reply(kind=request.kind, address=request.address, register=request.register, data=request.data)

    def refusal_reply(self, request, code):
        return Refusal(kind="refused", address=request.address, register=request.register, error=code)

    def damage_reply(self, find):
        if find.error.category == "checksum" and find.data[1] == self.address:
            return Refusal(kind="refused", address=self.address, register=find.data[3], error=SUM_ERROR)
        return None


def _in_page(place):
    return place.start % 10 if place.kind else place.start


@dataclass(frozen=True, slots=True, kw_only=True)
class AcmeOptions:
    """Options of an Acme drive.

    writes: storage of a plain write, "stored" or "volatile". end: number of carriage returns after each telegram.
    """

    writes: str = "stored"
    end: int = 0


SETTINGS = LineSettings(baudrate=9600, bytesize=8, parity="N")
ACME = register_protocol(
    dialect=AcmeDialect,
    codec=lambda options: AcmeCodec(options.end),
    options=AcmeOptions,
    facts=LineFacts(
        settings=SETTINGS,
        timing=Timing(reply_timeout_s=0.1, gap_s=0.05, turnaround_s=0.002, broadcast_pause_s=0.02, attempts=3),
    ),
    name="acme",
    title="Acme drive",
    package="profiles",
    facts_source="invented",
    addresses=range(1, 32),
    scan_addresses=range(1, 32),
    default_model="acme",
    line_errors={"error": frozenset({SUM_ERROR})},
    forms=lambda: FORMS,
    message=lambda given, direction: message_of(Request if direction == "request" else Reply, given, "a telegram"),
)
MODEL = read_model(Path(__file__).parent / "acme.toml", "acme")


@contextmanager
def on_a_line(*addresses, model=MODEL, **options):
    """Yield a virtual line, a bus on it, a function that lists the bytes sent, and the drives of the bus."""
    take_away = installed.register(ACME)
    try:
        line, heard = VirtualLine([virtual_drive("acme", each, model=model, **options) for each in addresses]), []
        with drivecomm.open_bus(line.port, trace=heard.append) as bus:
            drives = [bus.drive("acme", each, model=model, **options) for each in addresses]
            yield line, bus, lambda: [each.data for each in heard if each.what == "sent"], *drives
    finally:
        take_away()


def telegram(kind, register, data=0, address=1):
    """Return the bytes of a request."""
    return AcmeCodec().encode(Request(kind=kind, address=address, register=register, data=data))
