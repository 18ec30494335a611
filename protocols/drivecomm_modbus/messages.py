"""Content of a Modbus telegram: one dataclass for requests and one for replies, because functions share fields.

A field that is None is not in the telegram. All numbers are as in the telegram: register addresses count from 0, and
values are unsigned.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivecomm_modbus.functions import NAMES


@dataclass(frozen=True, slots=True, kw_only=True)
class Telegram:
    """Fields that requests and replies have in common.

    transaction: over TCP, the number that a reply repeats from its request.
    """

    address: int
    function: int
    start: int | None = None
    count: int | None = None
    value: int | None = None
    values: tuple[int, ...] | None = None
    sub_function: int | None = None
    read_code: int | None = None
    transaction: int | None = None

    @property
    def kind(self) -> str:
        """The name of the function, or "exception" for a refusal."""
        refused = getattr(self, "exception", None) is not None
        return "exception" if refused else NAMES.get(self.function, "unknown")


@dataclass(frozen=True, slots=True, kw_only=True)
class Request(Telegram):
    """A telegram of the master. write_start: first written register of function 17, whose data are `values`."""

    write_start: int | None = None
    object_id: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply(Telegram):
    """A telegram of a drive. exception: code of a refusal. data: of function 11, as hexadecimal text."""

    exception: int | None = None
    status: int | None = None
    event_count: int | None = None
    data: str | None = None
    conformity: int | None = None
    more_follows: int | None = None
    next_object: int | None = None
    object_ids: tuple[int, ...] | None = None
    texts: tuple[str, ...] | None = None
