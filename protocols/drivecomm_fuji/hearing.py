"""What an inverter makes of a request that is none: silence, or which NAK.

FRENIC5000G11S RS-485 manual p. 13, FRENIC-VG option manual 5-27: section 2.6 of the specification. Frames with a wrong
sum meet silence, so that several inverters do not answer at once (FRENIC5000G11S technical information 2-57).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from drivecomm.protocol.schema import Form, Leaf, filler, hex_number, hex_sum
from drivecomm_fuji.codec import FujiCodec
from drivecomm_fuji.generations import CHECKSUM_ERROR, COMMAND_ERROR, DATA_ERROR, FORMAT_ERROR, FUNCTION_ERROR
from drivecomm_fuji.telegrams import ENQ, ETX, SPACE, TAIL, Poll, Select, Standard, head

if TYPE_CHECKING:
    from drivecomm.protocol import Damaged, Direction
    from drivecomm_fuji.generations import Profile


class Ear(FujiCodec):
    """The telegrams as an inverter hears them: also requests with a command that does not exist, to refuse them.

    Its NAKs repeat bytes 5 to 7 of the request, whatever they are.
    """

    def __init__(self, profile: Profile) -> None:
        super().__init__(profile, number_check=False)
        self.alike = ("fuji", profile.nak_filler)
        self._echo = _echo_form(profile.nak_filler.encode())

    def _form(self, message: Standard | Select | Poll) -> Form[Any]:
        return self._echo if isinstance(message, Standard) and message.kind == "nak" else super()._form(message)

    def _unlisted(self, head: bytes, direction: Direction) -> int:
        """The ETX shows which of the three forms of request it has."""
        if direction == "reply":
            return super()._unlisted(head, direction)
        for length in (8, 12):
            if len(head) < length - 2:
                return length - 2
            if head[length - 3 : length - 2] == ETX:
                return length
        return 16


Complaint: TypeAlias = tuple[int, Standard | Select | Poll | None]
"""What an inverter says to a damaged request: the code for M26, and the NAK, None for silence."""


def complaint(damage: Damaged, address: int) -> Complaint | None:
    """Return what the inverter at this station says to a damaged request, None when it takes no notice."""
    data = damage.data
    if data[1:3] != b"%02d" % address or len(data) not in (8, 12, 16) or damage.error.category == "length":
        return None
    if hex_sum(data[1:-2]) != data[-2:]:
        return CHECKSUM_ERROR, None
    if data[3:4] != ENQ:
        return _refusal(data, address, FORMAT_ERROR)
    code = {"command": COMMAND_ERROR, "function": FUNCTION_ERROR, "data": DATA_ERROR}.get(
        damage.error.field, FORMAT_ERROR
    )
    command = chr(data[4])
    if len(data) == 16 or code == COMMAND_ERROR:
        return _refusal(data, address, code)
    kind: type[Select | Poll] = Select if len(data) == 12 else Poll
    return code, kind(kind="nak", address=address, command=command)


def _refusal(data: bytes, address: int, code: int) -> Complaint:
    """The standard NAK; instead of a command that does not exist it repeats R, which a host can tell the length of."""
    command = chr(data[4]) if chr(data[4]) in "RWAE" else "R"
    echo = data[5:8].decode("latin-1")
    return code, Standard(kind="nak", address=address, command=command, function=echo, error_code=code)


def _echo_form(space: bytes) -> Form[Standard]:
    echo = Leaf(
        3, lambda found: found.decode("latin-1"), lambda text: str(text).encode("latin-1"), meaning="as in the request"
    )
    code = "error_code" / hex_number(2)
    return Form(Standard, *head(["nak"], "RWAE"), "function" / echo, SPACE, filler(space), code, *TAIL)
