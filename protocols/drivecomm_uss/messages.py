"""What the telegrams of USS say.

special, mirror, broadcast and address are the parts of ADR. data is what a special or a mirror telegram carries, in
hexadecimal, and enable the broadcast enable array, in place of everything else. ak, spm and pnu are the parts of PKE:
task or reply identifier, toggle bit, parameter number; index and page, or parameter_set, text_field and text_write, the
parts of IND. value, values, error and text are the content of PWE, unsigned; pwe are its words as they stand, where AK
says nothing of them, or where there are more of them, or others, than the content needs. pzd are the process words from
the third on. What is None is not in the telegram.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, TypeAlias

from drivecomm.protocol.schema import wrong_field

if TYPE_CHECKING:
    from collections.abc import Collection

Words: TypeAlias = tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Telegram:
    special: bool = False
    mirror: bool = False
    broadcast: bool = False
    address: int | None = None
    data: str | None = None
    ak: int | None = None
    spm: bool | None = None
    pnu: int | None = None
    index: int | None = None
    page: int | None = None
    parameter_set: int | None = None
    text_field: int | None = None
    text_write: bool | None = None
    value: int | None = None
    values: Words | None = None
    text: str | None = None
    pwe: Words | None = None

    @property
    def kind(self) -> str:
        """Which telegram it is: special, mirror, broadcast, parameter (with a PKW area) or process (without one)."""
        for name in ("special", "mirror", "broadcast"):
            if getattr(self, name):
                return name
        return "process" if self.ak is None and self.pnu is None else "parameter"

    def must_have_only(self, names: Collection[str]) -> None:
        """Refuse content beyond these fields. Raises TelegramError."""
        for field in fields(self)[4:]:
            if field.name not in names and getattr(self, field.name) is not None:
                raise wrong_field(
                    field.name, f"this {self.kind} telegram has none; is it a special, mirror or broadcast?"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class Request(_Telegram):
    """A telegram of the master."""

    enable: Words | None = None
    control_word: int | None = None
    reference: int | None = None
    pzd: Words | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply(_Telegram):
    """A telegram of a drive; error is why it cannot do what it was asked (AK 7)."""

    error: int | None = None
    status_word: int | None = None
    actual: int | None = None
    pzd: Words | None = None
