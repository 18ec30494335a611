"""Differences between USS drives, which are configurable for that reason."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Literal, TypeAlias

from drivecomm.errors import UsageError
from drivecomm.protocol import exact, reference_limit_of

Ind: TypeAlias = Literal["page", "masterdrives", "nord", "plain", "word"]
Hertz: TypeAlias = Decimal | int | float | str
VARIABLE: Literal[127] = 127


@dataclass(frozen=True, slots=True, kw_only=True)
class UssOptions:
    """Options of a drive that speaks USS; the models set those of their series.

    pkw_words, pzd_words: number of words of the parameter area and of the process data, which are settings of the drive
    (P2013 and P2012 on MICROMASTER 4, p2023 and p2022 on G120): 0, 3, 4 or 127 for variable, and 0 to 16. No telegram
    shows them, and a drive does not answer telegrams of another length. ind: layout of the index word: "page"
    (MICROMASTER 4, G110, V20, G120, S110), "masterdrives", "nord", "plain", or "word" for the whole word. index_base:
    the index of an array's first element.

    eeprom_tasks: the tasks whose values survive power-off: 11 to 14 by the USS specification, 2 to 8 on NORD drives, or
    none if the tables of a series end at 8.

    mirror: the drive sends mirror telegrams back, so that `probe` sends nothing that it evaluates. broadcast: it obeys
    broadcasts, as far as its lengths allow, see `obeys_broadcasts`. reverse_bit: the bit of the control word that
    reverses, -1 for none. right_bit: the bit that is set for the other direction, -1 for none. running_needs_control: a
    running motor trips if control word bit 10 is 0 (F07220 on G120), so every telegram repeats the present command,
    even one that only reads. reference_parameter: the parameter that shows the reference from the bus, empty for none.
    error_family: the manufacturer whose error numbers above 100 apply.

    reference_frequency_hz: the frequency of 100 % (P2000 on MICROMASTER 4), for `set_reference(hz=)` and for the output
    frequency of a status. reference_limit: the largest percentage of P2000 that `set_reference` sends, at most 200 %,
    for drives whose maximum frequency (P1082) is above P2000. state_timeout_s: seconds in which a commanded state must
    be reached. reply_delay_s: reply delay of a virtual drive, in seconds.
    """

    pkw_words: Literal[0, 3, 4, 127] = VARIABLE
    pzd_words: int = 2
    ind: Ind = "page"
    index_base: Literal[0, 1] = 0
    eeprom_tasks: Literal["11-14", "2-8", "none"] = "11-14"
    mirror: bool = True
    broadcast: bool = True
    reverse_bit: Literal[-1, 11, 12] = 11
    right_bit: Literal[-1, 11] = -1
    running_needs_control: bool = False
    reference_parameter: str = ""
    error_family: Literal["siemens", "g120", "nord"] = "siemens"
    reference_frequency_hz: Hertz | None = None
    reference_limit: Hertz = 100
    state_timeout_s: float = 2.0
    reply_delay_s: float = 0.005

    def __post_init__(self) -> None:
        if self.pzd_words not in range(17):
            raise UsageError(f"pzd_words is 0 to 16, not {self.pzd_words}")
        reference_limit_of(self.reference_limit)
        if self.hertz is not None and self.hertz <= 0:
            raise UsageError(f"reference_frequency_hz {self.reference_frequency_hz} is not above 0")

    @property
    def obeys_broadcasts(self) -> bool:
        """Whether a broadcast reaches the drive.

        The broadcast enable array takes 4 words of PKW area (Appendix 2 to 4). NORD drives also obey without a PKW area
        (BU 0050 p. 42).
        """
        without = self.ind == "nord" and not self.pkw_words
        return self.broadcast and (without or self.pkw_words in (4, VARIABLE))

    @property
    def hertz(self) -> Decimal | None:
        """The exact frequency of 100 %; None if unknown."""
        given = self.reference_frequency_hz
        return None if given is None else exact(given, "reference_frequency_hz")

    def process_words(self, **words: int) -> dict[str, Any]:
        """Return these words of the process data, as far as the drive has them, and zeros for its other words."""
        own: dict[str, Any] = dict(list(words.items())[: self.pzd_words])
        return own | ({"pzd": (0,) * (self.pzd_words - 2)} if self.pzd_words > 2 else {})
