"""Models grown from the drive itself, where its protocol lets it tell what its parameters are.

A protocol takes part by a verb `describe(parameter)` among its operations' `extra`, whose exchange gives a
`ParameterInfo` with the source that the protocol names, and raises RefusedError for a parameter that the drive does not
have. Further keywords of it are the protocol's own.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.errors import DamagedReplyError, NotSupported, RefusedError, UnexpectedReplyError, UsageError
from drivecomm.protocol import Model

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from typing import Any, TypeAlias

    from drivecomm.bus import Drive
    from drivecomm.protocol import ParameterInfo

Described: TypeAlias = "ParameterInfo | RefusedError | UnexpectedReplyError | DamagedReplyError"
"""What a drive tells of a parameter, or why it does not."""

_VERB = "describe"
_RANGE_ENDS = re.compile(r"(?P<before>.*?)(?P<number>\d+)", re.ASCII)

# Two groups of a hundred numbers are some minutes of a serial line; a slip of a digit would be hours.
_LONGEST_RANGE = 10_000


def addresses_in(words: Iterable[str]) -> list[str]:
    """Return the parameter addresses that words name: `16-14` one, `16-10..16-18` and `200..240` each of a range.

    The ends of a range differ in their last number only, which is counted up with its leading zeros. Each address comes
    once, in the order of the words. Raises UsageError for a range that is none.
    """
    return list(dict.fromkeys(address for word in words for address in _addresses(word)))


def descriptions(
    drive: Drive, addresses: Iterable[str], options: Mapping[str, Any] | None = None
) -> Iterator[tuple[str, Described]]:
    """Ask a drive what each of these parameters is; yield it, or why the drive does not tell, as the answers come.

    options: keywords of the protocol's verb `describe`. Raises NotSupported for a drive whose protocol does not let it
    tell, and what `Drive.read` raises for a drive that does not answer.
    """
    for address in addresses:
        yield address, _described(drive, address, options or {})


def grown(
    described: Iterable[ParameterInfo], *, protocol: str, name: str, title: str, source: str, base: Model | None = None
) -> Model:
    """Return a model of what a drive told.

    base: the model that the drive was taken for. What it knows beyond the drive's own word comes from there: options of
    the drive, fault texts, which parameter is which quantity, its watchdog, and of each parameter its name, what it
    keeps over power-off, option texts that the drive does not have, and what only the protocol knows of it.
    """
    parameters: dict[str, ParameterInfo] = {}
    taken: set[str] = set()
    for told in described:
        known = base.parameters.get(told.address) if base else None
        info = _with(told, known) if known else told
        if info.name in taken:
            info = replace(info, name=f"{info.name}_{_joined(info.address)}")
        taken.add(info.name)
        parameters[info.address] = info
    if base is None:
        return Model(
            protocol=protocol, name=name, title=title, source=source, parameters=parameters, faults={}, options={}
        )
    for info in list(parameters.values()):
        left = {address: codes for address, codes in info.only_with.items() if address in parameters}
        parameters[info.address] = replace(info, only_with=left)
    watchdog = base.watchdog
    if watchdog and not {watchdog.time, watchdog.action or watchdog.time} <= set(parameters):
        watchdog = None
    return replace(
        base,
        name=name,
        title=title,
        source=source,
        parameters=parameters,
        quantities={
            common: address
            for common, address in base.quantities.items()
            if address in parameters or address.partition("[")[0] in parameters
        },
        watchdog=watchdog,
        # Two models with one rule would leave open which of them a drive is.
        identified_by={},
    )


def _with(told: ParameterInfo, known: ParameterInfo) -> ParameterInfo:
    return replace(
        known,
        title=told.title,
        type=told.type,
        unit=told.unit,
        factor=told.factor,
        # That a drive refuses to be written while its motor runs is nothing that it tells beforehand.
        access=known.access if told.access == "rw" and known.access == "rw*" else told.access,
        values={**known.values, **told.values},
        minimum=told.minimum,
        maximum=told.maximum,
        start=known.start if told.start is None else told.start,
        source=told.source,
        sure=told.sure,
        extra={**known.extra, **told.extra},
    )


def _described(drive: Drive, address: str, options: Mapping[str, Any]) -> Described:
    try:
        info: ParameterInfo = drive.call(_VERB, parameter=address, **options)
    except NotSupported as error:
        raise NotSupported(
            f"{drive.name} does not tell what its parameters are, so no model can be grown from it; write one by hand, "
            "beginning with `extends`"
        ) from error
    except (RefusedError, UnexpectedReplyError, DamagedReplyError) as reason:
        return reason
    return info


def _addresses(word: str) -> Iterator[str]:
    first, dots, last = word.partition("..")
    if not dots:
        yield word
        return
    begin, end = _RANGE_ENDS.fullmatch(first), _RANGE_ENDS.fullmatch(last)
    if begin is None or end is None or begin["before"] != end["before"]:
        raise UsageError(f"{word!r} is no range; write its first and its last parameter, such as 16-10..16-18")
    low, high = int(begin["number"]), int(end["number"])
    if high < low or high - low >= _LONGEST_RANGE:
        raise UsageError(f"the range {word!r} has no parameters, or more than {_LONGEST_RANGE}")
    width = len(begin["number"])
    for number in range(low, high + 1):
        yield f"{begin['before']}{number:0{width}d}"


def _joined(address: str) -> str:
    return "_".join(re.findall(r"[a-z0-9]+", address.lower()))
