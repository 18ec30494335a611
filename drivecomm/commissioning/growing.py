"""Models grown from a drive: from the parameters that it describes, or from the addresses that it answers.

A protocol offers descriptions as a verb `describe(parameter)` among the `extra` of its operations. The exchange of that
verb gives a `ParameterInfo` with the source that the protocol names. It raises RefusedError for a parameter that the
drive does not have. Further keywords of the verb belong to the protocol.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from drivecomm.bus import read_parameter
from drivecomm.commissioning.exploring import chosen_course, course, without_elements
from drivecomm.errors import DamagedReplyError, NotSupported, RefusedError, UnexpectedReplyError, UsageError
from drivecomm.models import parameter_at, without_proofs
from drivecomm.protocol import DESCRIBE, Model, ParameterInfo, Reading, resolve_options

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping
    from typing import Any, TypeAlias

    from drivecomm.bus import Drive
    from drivecomm.commissioning.exploring import AddressAnswer, Asks, ExplorationPlan
    from drivecomm.protocol import Protocol

Described: TypeAlias = "ParameterInfo | RefusedError | UnexpectedReplyError | DamagedReplyError"
"""A drive's description of a parameter, or the reason why it gave none."""

_RANGE_ENDS = re.compile(r"(?P<before>.*?)(?P<number>\d+)", re.ASCII)

# Two groups of a hundred parameters take minutes on a serial line; a mistyped digit would take hours.
_LONGEST_RANGE = 10_000


def addresses_in(words: Iterable[str]) -> list[str]:
    """Return the parameter addresses named by words: `16-14` is one, `16-10..16-18` and `200..240` are ranges.

    The ends of a range differ only in their last number, which is counted up and keeps its leading zeros. Each address
    appears once, in the order of the words. Raises UsageError for an invalid range.
    """
    return list(dict.fromkeys(address for word in words for address in _addresses(word)))


def descriptions(
    drive: Drive, addresses: Iterable[str], options: Mapping[str, Any] | None = None
) -> Iterator[tuple[str, Described]]:
    """Ask a drive to describe each of these parameters; yield each description, or the reason why it is missing.

    options: keywords of the protocol's verb `describe`. Raises NotSupported if the protocol has no such verb, and the
    errors of `Drive.read` if the drive does not answer.
    """
    for address in addresses:
        yield address, _described(drive, address, options or {})


def growth_plan(plugin: Protocol, model: Model | None, words: Collection[str] | None) -> ExplorationPlan:
    """Return the addresses to request from a drive to grow a model from its answers.

    words: the addresses to request, see `addresses_in`; None for all that a drive can hold. Raises NotSupported if the
    addresses of a drive are unknown.
    """
    if words is not None:
        return chosen_course(plugin, model, addresses_in(words))
    infos = [] if model is None else list(model.parameters.values())
    if _describes(plugin, model):
        return without_elements(course(plugin, model, known=[info.address for info in infos]))
    _, options = resolve_options(plugin, model, {})
    readable = [info for info in infos if _may_be_asked(info)]
    return course(
        plugin,
        model,
        known=[address for info in readable for address in plugin.element_addresses(info, options)],
    )


def growth_request(plugin: Protocol, model: Model | None, options: Mapping[str, Any]) -> Asks:
    """Return the request for one parameter: for its description if the protocol supports that, else for its value.

    options: keywords of the protocol's verb `describe`. Raises UsageError if options are given and there is no such
    verb.
    """
    if _describes(plugin, model):
        return lambda address: lambda drive: drive.call(DESCRIBE, parameter=address, **options)
    if options:
        raise UsageError(
            f"{plugin.name} drives do not describe their parameters, so there are no options of describe; leave "
            f"{', '.join(options)} out"
        )
    return read_parameter


def parameters_of(
    answers: Iterable[AddressAnswer], plugin: Protocol, base: Model | None, drive: str
) -> list[ParameterInfo]:
    """Return the parameters that a drive has, judged by its answers.

    A parameter that the drive described is taken from the description. A parameter that only gave a value is taken from
    base; if base does not have it, it is read-only, without type, and unconfirmed until its meaning is known. drive:
    name of the drive, for the source.
    """
    _, options = resolve_options(plugin, base, {})
    space = plugin.address_space(options, base) if plugin.address_space is not None else None
    together = space.together if space is not None else None
    found: dict[str, ParameterInfo] = {}
    for answer in answers:
        if isinstance(answer.told, ParameterInfo):
            found[answer.told.address] = answer.told
        elif isinstance(answer.told, Reading):
            info = _known(answer.address, base) or _unknown(answer.address, together, drive)
            found.setdefault(info.address, info)
    return list(found.values())


def unread_parameters(plugin: Protocol, base: Model | None) -> list[ParameterInfo]:
    """Return the parameters of base whose values are never requested: commands and write-only parameters.

    The drive may have these parameters all the same. The result is empty for a protocol whose drives describe their
    parameters: their descriptions are requested, too.
    """
    if base is None or _describes(plugin, base):
        return []
    return [info for info in base.parameters.values() if not _may_be_asked(info)]


def _may_be_asked(info: ParameterInfo) -> bool:
    return "r" in info.access and info.kind != "command"


def _describes(plugin: Protocol, model: Model | None) -> bool:
    _, options = resolve_options(plugin, model, {})
    return DESCRIBE in plugin.operations(plugin.addresses[0], options, model).extra


def _known(address: str, base: Model | None) -> ParameterInfo | None:
    return None if base is None else parameter_at(address, without_proofs(base))


def _unknown(address: str, together: Mapping[str, Any] | None, drive: str) -> ParameterInfo:
    whole, bracket, _ = address.partition("[")
    one = address if together is None else whole
    return ParameterInfo(
        address=one,
        name=f"parameter_{_joined(one)}",
        title=f"parameter {one}",
        access="r",
        source=f"answered by {drive}",
        sure="unconfirmed",
        extra=dict(together or {}) if bracket else {},
    )


def grown_model(
    described: Iterable[ParameterInfo], *, protocol: str, name: str, title: str, source: str, base: Model | None = None
) -> Model:
    """Return a model made from the parameters that a drive described.

    base: the model by which the drive was addressed. It supplies what the drive does not report: options of the drive,
    fault texts, quantities and watchdog. For each parameter it supplies the name, whether its value is kept over
    power-off, option texts that the drive does not have, and protocol-specific data.
    """
    if base is not None:
        # Proofs hold only for the drives of their own model file.
        base = without_proofs(base)
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
    for given in base.control.values():
        # Commanding the drive is taken over from base, so the parameters that it needs are as well.
        for address in given if isinstance(given, tuple) else (given,):
            if isinstance(address, str) and address in base.parameters:
                parameters.setdefault(address, base.parameters[address])
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
        quantities={common: address for common, address in base.quantities.items() if _is_in(parameters, address)},
        fault_log=tuple(address for address in base.fault_log if _is_in(parameters, address)),
        watchdog=watchdog,
        setup=tuple(each if _is_in(parameters, each.address) else replace(each, address="") for each in base.setup),
        # Two models with the same rule would make the identification of a drive ambiguous.
        identified_by={},
    )


def _is_in(parameters: Mapping[str, ParameterInfo], address: str) -> bool:
    return address in parameters or address.partition("[")[0] in parameters


def _with(told: ParameterInfo, known: ParameterInfo) -> ParameterInfo:
    return replace(
        known,
        title=told.title,
        type=told.type,
        unit=told.unit,
        factor=told.factor,
        # A drive does not report in advance that it refuses writes while its motor runs.
        access=known.access if told.access == "rw" and known.access == "rw*" else told.access,
        values={**known.values, **told.values},
        minimum=told.minimum,
        maximum=told.maximum,
        start=known.start if told.start is None else told.start,
        source=told.source,
        sure=told.sure,
        proof="",
        extra={**known.extra, **told.extra},
    )


def _described(drive: Drive, address: str, options: Mapping[str, Any]) -> Described:
    try:
        info: ParameterInfo = drive.call(DESCRIBE, parameter=address, **options)
    except NotSupported as error:
        raise NotSupported(
            f"{drive.name} does not describe its parameters, so no model can be grown from it; write one by hand, "
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
        raise UsageError(f"{word!r} is not a range; write its first and its last parameter, such as 16-10..16-18")
    low, high = int(begin["number"]), int(end["number"])
    if high < low or high - low >= _LONGEST_RANGE:
        raise UsageError(f"the range {word!r} has no parameters, or more than {_LONGEST_RANGE}")
    width = len(begin["number"])
    for number in range(low, high + 1):
        yield f"{begin['before']}{number:0{width}d}"


def _joined(address: str) -> str:
    return "_".join(re.findall(r"[a-z0-9]+", address.lower()))
