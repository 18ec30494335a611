"""Contents of USS telegrams.

special, mirror, broadcast and address are the parts of ADR. data is the content of a special or mirror telegram, in
hexadecimal, and enable the broadcast enable array, in place of all other fields. ak, spm and pnu are the parts of PKE:
task or reply identifier, toggle bit, parameter number; index and page, or parameter_set, text_field and text_write, are
the parts of IND. value, values, error and text are the content of PWE, unsigned; pwe holds its words unchanged, if AK
does not define them, or if they differ from the words that the content needs. pzd are the process words from the third
on. A field that is None is not in the telegram.
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
        """The kind of telegram: special, mirror, broadcast, parameter (with a PKW area) or process (without one)."""
        for name in ("special", "mirror", "broadcast"):
            if getattr(self, name):
                return name
        return "process" if self.ak is None and self.pnu is None else "parameter"

    def must_have_only(self, names: Collection[str]) -> None:
        """Raise TelegramError for content in other fields than these."""
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
    """A telegram of a drive. error: reason why it cannot carry out the task (AK 7)."""

    error: int | None = None
    status_word: int | None = None
    actual: int | None = None
    pzd: Words | None = None
