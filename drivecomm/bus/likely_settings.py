"""Likely line settings of the drives of a protocol, most likely first.

The settings that a protocol's package names come first: its default, then the speeds and formats that its models list
as options of their own communication parameters. Settings of other serial equipment come last.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from itertools import product
from typing import TYPE_CHECKING, TypeVar

from drivecomm.protocol import USUAL_BAUD_RATES, LineSettings, Parity

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from drivecomm.protocol import Model, Protocol

T = TypeVar("T")


USUAL_FORMATS: tuple[tuple[int, Parity, float], ...] = (
    (8, "N", 1),
    (8, "E", 1),
    (7, "E", 1),
    (8, "O", 1),
    (8, "N", 2),
    (7, "O", 1),
    (7, "N", 2),
)
"""Data bits, parity and stop bits of serial equipment, most usual first."""

# Users change the speed of a drive more often than its character format.
_FORMAT_WEIGHT = 2
# Settings that a protocol's package does not name come after all that it names.
_UNNAMED = 6

_PARITY_WORDS: tuple[tuple[str, Parity], ...] = (("even", "E"), ("odd", "O"), ("no", "N"))
_RATE = re.compile(r"\b(\d{3,6})\b")


@dataclass(frozen=True, slots=True, kw_only=True)
class LineChoices:
    """Line settings that a wide scan tries. An empty field stands for all likely values.

    baudrates: bits per second. bytesizes: data bits, 7 or 8. parities: N, E, O, M or S. stopbits: 1, 1.5 or 2. Each
    field has the order in which its values are tried.
    """

    baudrates: tuple[int, ...] = ()
    bytesizes: tuple[int, ...] = ()
    parities: tuple[Parity, ...] = ()
    stopbits: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for baudrate, (bytesize, parity, stopbits) in product(
            self.baudrates or (9600,),
            product(self.bytesizes or (8,), self.parities or ("N",), self.stopbits or (1,)),
        ):
            # Raises UsageError for invalid values.
            LineSettings(baudrate=baudrate, bytesize=bytesize, parity=parity, stopbits=stopbits)

    def allow(self, settings: LineSettings) -> bool:
        """Return whether these settings are among the chosen ones."""
        given = (settings.baudrate, settings.bytesize, settings.parity, settings.stopbits)
        chosen = (getattr(self, field.name) for field in fields(self))
        return all(not some or one in some for one, some in zip(given, chosen, strict=True))


EVERYTHING_LIKELY = LineChoices()


@dataclass(frozen=True, slots=True)
class LikelySettings:
    """Line settings, and how unlikely they are for a drive of a protocol: 0 for its default."""

    settings: LineSettings
    unlikeliness: int


def likely_settings(
    plugin: Protocol, models: Iterable[Model], choices: LineChoices = EVERYTHING_LIKELY, *, eight_bits: bool = False
) -> list[LikelySettings]:
    """Return the line settings to try for a protocol, most likely first.

    models: models of its package, which name the settings that their drives have. eight_bits: whether its telegrams
    have bytes that seven data bits cannot carry.
    """
    default = plugin.facts.settings
    known = list(models)
    named_rates, named_formats = _named_rates(known), _named_formats(known, default)
    rates = _ranked([default.baudrate], named_rates, choices.baudrates or USUAL_BAUD_RATES)
    given = choices.bytesizes or choices.parities or choices.stopbits
    chosen = product(
        choices.bytesizes or (default.bytesize,), choices.parities or (default.parity,), choices.stopbits or (1,)
    )
    formats = _ranked(
        [(default.bytesize, default.parity, default.stopbits)],
        named_formats,
        [*(chosen if given else ()), *USUAL_FORMATS],
    )
    found = [
        LikelySettings(
            LineSettings(baudrate=rate, bytesize=bits[0], parity=bits[1], stopbits=bits[2]),
            rate_place + _FORMAT_WEIGHT * format_place,
        )
        for (rate, rate_place), (bits, format_place) in product(rates, formats)
        if not (eight_bits and bits[0] < 8)
    ]
    allowed = [each for each in found if choices.allow(each.settings)]
    return sorted(allowed, key=lambda each: each.unlikeliness)


def _ranked(default: Sequence[T], named: Sequence[T], usual: Sequence[T]) -> list[tuple[T, int]]:
    """Return each value once, with its rank; values that are only usual rank far behind the others."""
    said = list(dict.fromkeys([*default, *named]))
    further = [each for each in dict.fromkeys(usual) if each not in said]
    # If a package names nothing, usual values need not rank far behind.
    behind = _UNNAMED if len(said) > 1 else 0
    return [
        *((each, place) for place, each in enumerate(said)),
        *((each, len(said) + place + behind) for place, each in enumerate(further)),
    ]


def _named_rates(models: Iterable[Model]) -> list[int]:
    rates = {int(each) for text in _options(models, "baud_rate") for each in _RATE.findall(text)}
    allowed = [rate for rate in rates if 300 <= rate <= 1_000_000]
    order = {rate: place for place, rate in enumerate(USUAL_BAUD_RATES)}
    return sorted(allowed, key=lambda rate: (order.get(rate, len(order)), rate))


def _named_formats(models: Sequence[Model], default: LineSettings) -> list[tuple[int, Parity, float]]:
    """Return the formats that differ from the default in one property; the usual formats cover two at a time."""
    found: list[tuple[int, Parity, float]] = []
    for text in _options(models, "parity"):
        word = next((parity for start, parity in _PARITY_WORDS if text.lower().startswith(start)), None)
        if word is not None:
            found.append((default.bytesize, word, default.stopbits))
    sizes = (int(text[0]) for text in _options(models, "data_bits") if text[:1] in ("7", "8"))
    found += [(size, default.parity, default.stopbits) for size in sizes]
    stops = (int(text[0]) for text in _options(models, "stop_bits") if text[:1] in ("1", "2"))
    found += [(default.bytesize, default.parity, stop) for stop in stops]
    return list(dict.fromkeys(found))


def _options(models: Iterable[Model], name: str) -> Iterator[str]:
    """Yield the option texts of the parameters that hold a communication setting, such as link_1_baud_rate."""
    for model in models:
        for info in model.parameters.values():
            if info.name == name or info.name.endswith(f"_{name}"):
                yield from info.values.values()
