"""Parameters and instruction codes of a drive in telegrams (FR-D700 manual p. 189, FR-F500 p. 114).

`7` is Pr. 7, `H6F` an instruction code, `H74.low` its low byte. Parameters are on pages, selected by FF. On page 00
code and number are the same; the codes on the others follow no rule (Pr. 240 is 30 on page 02), so the model gives
them.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from drivecomm.errors import NotSupported, ParameterAddressError, UnexpectedReplyError
from drivecomm.profiles import Access, Dialect, RegisterPlace, RegisterRefusal, VirtualRegisterDrive
from drivecomm.protocol import Ask, code_texts
from drivecomm_mitsubishi.telegrams import LONG, SHORT, Ack, Data, Multi, MultiReply, Nak, Read, Write

if TYPE_CHECKING:
    from collections.abc import Sequence

_PAGE, _RUN, _FIRST = 0xFF, 0xFA, 0x6C  # _FIRST: lowest instruction code; below it are parameters
_PAIRED = (0x6C, 0x6D, 0x6E, 0x7B, 0x7F)
"""Codes that are written as themselves + 80. For other codes, code + 80 differs: 7A is the status, FA starts."""


class MitsubishiDialect(Dialect):
    """The parameters and instruction codes of one drive. page: the selected page, in a virtual drive."""

    title = "Mitsubishi computer link"
    requests = (Read, Write, Multi)
    probe = RegisterPlace("h", 0x7A)
    repeats = {"multi_reply": ("send_type", "receive_type")}  # noqa: RUF012 - never changed
    refusals = code_texts(__file__, "errors.toml")
    codes = {"unknown": 11, "read only": 11, "running": 10, "not set up": 10, "limits": 12}  # noqa: RUF012 - never changed
    stop_again = range(6)
    feeds_all = True
    follows = ("maximum_frequency",)
    advice = "its operation mode (Pr. 79, 338 to 340) and its terminals"
    page = 0

    def place_of(self, address: str) -> RegisterPlace:
        """Return the place of an address. Raises ParameterAddressError."""
        found = re.fullmatch(r"H([0-9A-F]{2})(?:\.(low|high))?|(0|[1-9][0-9]{0,3})", str(address), re.ASCII)
        if found is None:
            raise ParameterAddressError(
                f"{address!r} is neither a parameter nor a code; write 7 for Pr. 7, or H6F, H74.low"
            )
        return RegisterPlace("", int(found[3])) if found[3] else RegisterPlace("h", int(found[1], 16), found[2] or "")

    def address_at(self, place: RegisterPlace) -> str:
        """Return the address of a place as messages print it."""
        return f"H{place.start:02X}" if place.kind else str(place.start)

    def allowed(self, place: RegisterPlace) -> range | None:
        """Return the numbers that a place can hold if it has only two digits, else None."""
        return range(256) if place.kind and self._digits(place.start) == 2 else None

    def preparing(self, place: RegisterPlace) -> Ask | None:
        """Return the request that selects the page of a parameter; None for an instruction code.

        The page is a state of the drive that another master may have changed.
        """
        return None if place.kind else self._ask(Write, _PAGE, self._paged(place)[0])

    def reading(self, place: RegisterPlace, _count: int, /) -> Ask:
        """Return the request that reads a place."""
        if (code := self._paged(place)[1]) >= 0x80:
            raise NotSupported(f"H{code:02X} can only be written")
        return self._ask(Read, code)

    def writing(self, place: RegisterPlace, words: Sequence[int], /) -> Ask:
        """Return the request that writes a place, or the command."""
        code = self._paged(place)[1]
        if place.kind and code < 0x80 and code not in _PAIRED:
            raise NotSupported(f"H{code:02X} can only be read; what H{code | 0x80:02X} writes is another thing")
        return self._ask(Write, code | 0x80, words[0])

    def silence_s(self, request: Any) -> float:
        """Return the seconds of silence after a request.

        9696 resets the drive without an answer (Shihlin SE2 manual p. 70).
        """
        return 2.0 if request.kind == "write" and (request.code, request.data) == ("FD", "9696") else 0.0

    def words(self, reply: Any, _place: RegisterPlace, /) -> tuple[int, ...]:
        """Return the word of a value. Raises UnexpectedReplyError for six digits, which are a speed."""
        if len(reply.data) > 4:
            raise UnexpectedReplyError(
                f"the drive reports {reply.data}, not four digits, as when Pr. 37 is set; set it to 0"
            )
        return (int(reply.data, 16),)

    def refusal(self, reply: Any) -> int | None:
        """Return the code of a refusal; None for any other reply."""
        return reply.error_code if reply.kind == "nak" else None

    def reply_kinds_of(self, request: Any) -> tuple[str, ...]:
        """Return the kinds of reply to a request."""
        return {"read": "data", "write": "ack", "multi": "multi_reply"}.get(request.kind, ""), "nak"

    def mismatch(self, request: Any, reply: Any) -> str:
        """Return the field in which a reply does not belong to a request; only station, kind and size are compared."""
        differs = super().mismatch(request, reply)
        if differs or reply.kind != "data":
            return "station" if differs == "address" else differs
        fitting = (4,) if reply.unit else (2,) if request.code in SHORT else (4, 6) if request.code in LONG else (4, 20)
        return "" if len(reply.data) in fitting else "data"

    def access_of(self, request: Any) -> Access | None:
        """Return the access that a request makes; None for the selection of a page. Raises RegisterRefusal."""
        self.reply_delay_s, code = 0.012 + (request.wait or 0) / 100, int(request.code, 16)
        word = None if request.kind == "read" else int(request.data1 if request.kind == "multi" else request.data, 16)
        if code == _PAGE and word is not None:
            self.page = word
            return None
        number, place = code & 0x7F, RegisterPlace("h", code)
        if number < _FIRST:
            paged = {self._paged(each): each.start for each in self.places if not each.kind}
            if self.page and self.model is not None and (self.page, number) not in paged:
                raise RegisterRefusal("unknown")
            place = RegisterPlace("", paged.get((self.page, number), number))
        elif number in _PAIRED and place not in self.places:
            place = RegisterPlace("h", number)
        elif request.code in ("FA", "F9") and (code == _RUN or place in self.places):
            # The low byte of F9 is FA, and forward and reverse together are a stop (from memory).
            place, word = RegisterPlace("h", _RUN), (word or 0) & (0xF9 if (word or 0) & 6 == 6 else 0xFF)
        return Access(place=place, words=None if word is None else (word,))

    def forget(self) -> None:
        """Reset the page, as a restart of the drive does."""
        self.page = 0

    def read_reply(self, request: Any, words: Sequence[int]) -> Any:
        """Return the value of a place; the meaning of a Shihlin drive's unit is unknown."""
        data, unit = f"{words[0]:0{self._digits(int(request.code, 16))}X}", self.options.dialect == "shihlin"
        return Data(station=self.address, data=data, unit="00" if unit else None)

    def write_reply(self, _request: Any) -> Any:
        """Return the reply to a write."""
        return Ack(station=self.address)

    def refusal_reply(self, _request: Any, code: int) -> Any:
        """Return the refusal of a request."""
        return Nak(station=self.address, error_code=code)

    def damage_reply(self, find: Any) -> Any:
        """Return the refusal of a damaged telegram (FR-D700 manual p. 192); None if it is for another station."""
        code = {"checksum": 2, "field": 7}.get(find.error.category, 3)
        return self.refusal_reply(None, code) if find.data[:3] == b"\x05%02X" % self.address else None

    def _digits(self, code: int) -> int:
        return 2 if f"{code:02X}" in SHORT and self.options.dialect != "shihlin" else 4

    def _paged(self, place: RegisterPlace) -> tuple[int, int]:
        """Return the page and the code of a place. Raises ParameterAddressError if they are unknown."""
        if place.kind or (place.start < 100 and self.options.dialect != "shihlin"):
            return 0, place.start
        info = self.places.get(place)
        if info is None or "code" not in info.extra:
            raise ParameterAddressError(f"page and code of Pr. {place.start} are not known; give them in a model")
        return info.extra["page"], info.extra["code"]

    def _ask(self, kind: type[Any], code: int, word: int | None = None) -> Ask:
        data, wait = {} if word is None else {"data": f"{word:0{self._digits(code)}X}"}, self.options.wait
        request = kind(station=self.address, code=f"{code:02X}", wait=wait, **data)
        return Ask(message=request, nameless=True, reply_timeout_s=0.2 + wait / 100 if wait else None)


class VirtualMitsubishiDrive(VirtualRegisterDrive):
    """A drive at one station."""

    def answer(self, request: Any, now: float) -> Any:
        """Carry out a request; a multi command runs, sets the frequency and reads in one telegram (FR-A800 p. 578)."""
        if request.kind != "multi":
            return super().answer(request, now)
        same, errors = {"station": self.address, "wait": request.wait}, list[int]()
        told = [self.answer(Read(code=code, **same), now).data for code in ("79", "6F")]
        for code, data in (("F9", request.data1), ("EE" if request.send_type else "ED", request.data2)):
            try:
                self.answer(Write(code=code, data=data, **same), now)
                errors.append(15)
            except RegisterRefusal as refusal:
                errors.append(self._dialect.codes[refusal.why])
        names = ("station", "send_type", "receive_type", "error1", "error2", "data1", "data2")
        found = (self.address, request.send_type, request.receive_type, *errors, *told)
        return MultiReply(**dict(zip(names, found, strict=True)))
