"""Trials of a model with its protocol, without a line: mistakes that only the protocol can show."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, fields, replace
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import (
    DriveCommError,
    NotSupported,
    ParameterAddressError,
    UsageError,
    ValueRefusedError,
    did_you_mean,
    unknown_key,
)
from drivecomm.models.files import load_model
from drivecomm.models.rules import starts_within_limits
from drivecomm.models.schema import PARAMETER_KEYS, Mistake
from drivecomm.protocol import LINE_FACT_NAMES, option_names, resolve_options

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from drivecomm.protocol import Model, Operations, ParameterInfo, Protocol

_PLAIN_VALUES = (Decimal(0), Decimal(1), Decimal(100))
_KINDS: dict[str, tuple[type, ...]] = {"bool": (bool,), "int": (int,), "str": (str,), "float": (int, float)}


def wrong_options(options: Mapping[str, Any], plugin: Protocol) -> Iterator[Mistake]:
    """Yield the options that drives of this protocol do not have, or not with this value."""
    own = option_names(plugin)
    allowed = own | LINE_FACT_NAMES
    kinds = {field.name: _KINDS.get(str(field.type)) for field in fields(plugin.options)}
    for name, value in options.items():
        kind = kinds.get(name)
        if name not in allowed:
            remedy = did_you_mean(name, allowed) or f"they have {', '.join(sorted(own)) or 'none of their own'}"
            text = f"{plugin.name} drives have no such option; {remedy}"
        elif kind is not None and (not isinstance(value, kind) or (isinstance(value, bool) and bool not in kind)):
            text = f"invalid value {value!r}"
        else:
            text = _trouble(plugin, {name: value})
        if text:
            yield Mistake(table="options", key=name, text=text)


def _trouble(plugin: Protocol, options: Mapping[str, Any]) -> str:
    try:
        resolve_options(plugin, None, options)
    except UsageError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - a package may raise anything for an unexpected value
        return f"invalid value {', '.join(map(repr, options.values()))} ({type(error).__name__}: {error})"
    return ""


def wrong_keys(entries: Sequence[tuple[int, Mapping[str, Any]]], plugin: Protocol) -> Iterator[Mistake]:
    """Yield the parameter keys that are unknown to the protocol, if it lists its keys."""
    if plugin.parameter_keys is None:
        return
    known = PARAMETER_KEYS | plugin.parameter_keys
    for number, entry in entries:
        for key in sorted(set(entry) - known):
            yield Mistake(table="parameter", number=number, key=key, text=unknown_key(key, sorted(known)))


def wrong_control_keys(control: Mapping[str, Any], plugin: Protocol) -> Iterator[Mistake]:
    """Yield the keys of [control] that this protocol does not know; most protocols know none."""
    for key in sorted(set(control) - plugin.control_keys):
        remedy = (
            unknown_key(key, sorted(plugin.control_keys)) if plugin.control_keys else f"{plugin.name} has no such table"
        )
        yield Mistake(table="control", key=key, text=remedy)


def failed_trials(own: Sequence[tuple[int, ParameterInfo]], model: Model, plugin: Protocol) -> Iterator[Mistake]:
    """Yield mistakes found by trial: unreadable parameters, impossible start values, and no possible virtual drive.

    The model's options must be those of the protocol.
    """
    try:
        options = resolve_options(plugin, model, {})[1]
        operations = plugin.operations(plugin.addresses[0], options, model)
    except Exception as error:  # noqa: BLE001 - as above
        yield Mistake(
            table="options", key="options", text=f"no drive of {plugin.name} can have these together: {_said(error)}"
        )
        return
    trial = _Trial(plugin=plugin, options=options, operations=operations)
    sound = []
    for number, info in own:
        key, text = trial.trouble_with(info, model)
        if text:
            yield Mistake(table="parameter", number=number, key=key, text=text)
        else:
            sound.append((number, info))
    # Leave out what is reported already, so that it is not reported twice.
    named = {info.address for _, info in own} - {info.address for _, info in sound}
    left = {address: info for address, info in model.parameters.items() if address not in named}
    trouble = trial.made_and_looked_at(replace(model, parameters=left), [info for _, info in sound])
    if not trouble:
        return
    # Try each parameter alone, on a model whose virtual drive is known to work, to find the wrong one.
    known = load_model(plugin.package, plugin.name, plugin.default_model)
    completed = replace(model, parameters={**known.parameters, **left})
    if not trial.made_and_looked_at(completed, [info for _, info in sound]):
        # The model only has too few parameters for a virtual drive, for example an explored one; masters can use it.
        return
    alone = [(number, info, trial.made_and_looked_at(_with(known, info), [info])) for number, info in sound]
    culprits = [
        Mistake(table="parameter", number=number, text=f"parameter {info.address}: {text}")
        for number, info, text in alone
        if text
    ]
    remedy = f"extend a model that has what a drive needs, such as extends = {plugin.default_model!r}"
    yield from culprits or [Mistake(text=f"{trouble}; {remedy}")]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Trial:
    """A drive without a line: its operations are only begun, and its virtual counterpart is made."""

    plugin: Protocol
    options: Any
    operations: Operations

    def trouble_with(self, info: ParameterInfo, model: Model) -> tuple[str, str]:
        """Return the wrong key and the reason if a parameter cannot be read or set; otherwise two empty strings."""
        try:
            _begin(self.operations.read, info.address)
        except NotSupported:
            # The parameter is write-only.
            pass
        except ParameterAddressError as error:
            return "address", str(error)
        except Exception as error:  # noqa: BLE001 - as above
            if info.type and self._reads_without_type(info, model):
                return "type", _said(error)
            return "", f"parameter {info.address}: {_said(error)}"
        start = info.start
        if start is None or "w" not in info.access or not starts_within_limits(info):
            return "", ""
        plain = ("A",) if isinstance(start, str) else (*_PLAIN_VALUES, info.minimum, info.maximum)
        refusal = self._refusal(info, start)
        # If no value at all is accepted, the start value is not at fault.
        if refusal and any(value is not None and not self._refusal(info, value) for value in plain):
            return "start", refusal
        return "", ""

    def made_and_looked_at(self, model: Model, infos: Sequence[ParameterInfo]) -> str:
        """Return why a virtual drive with these parameters cannot be made or read; empty if it can."""
        try:
            drive = self.plugin.virtual(self.plugin.addresses[0], self.options, model)
            for info in infos:
                # A drive may lack the parameter, or have it under another address, without a mistake in the file.
                with suppress(ParameterAddressError):
                    drive.peek(info.address, 0.0)
        except Exception as error:  # noqa: BLE001 - as above
            return f"no virtual drive can be made with it ({_said(error)})"
        return ""

    def _reads_without_type(self, info: ParameterInfo, model: Model) -> bool:
        without = _with(model, replace(info, type=""))
        try:
            _begin(self.plugin.operations(self.plugin.addresses[0], self.options, without).read, info.address)
        except Exception:  # noqa: BLE001 - as above
            return False
        return True

    def _refusal(self, info: ParameterInfo, value: Decimal | str) -> str:
        """Return why a value cannot be written; empty if it can, or if writing is refused for every value."""
        try:
            try:
                _begin(self.operations.write, info.address, value)
            except NotSupported:
                _begin(self.operations.write, info.address, value, store=True)
        except ValueRefusedError as error:
            return str(error)
        except DriveCommError:
            return ""
        except Exception as error:  # noqa: BLE001 - as above
            return _said(error)
        return ""


def _begin(verb: Any, *values: Any, **options: Any) -> None:
    """Run an operation up to its first request, which is not sent."""
    exchange = verb(*values, **options)
    with suppress(StopIteration):
        next(exchange)
    exchange.close()


def _with(model: Model, info: ParameterInfo) -> Model:
    return replace(model, parameters={**model.parameters, info.address: info})


def _said(error: Exception) -> str:
    return str(error) if isinstance(error, DriveCommError) else f"{type(error).__name__}: {error}"
