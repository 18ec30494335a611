"""Models as text for `drivecomm.models.files`, with one key a line, so that two versions compare well.

Only keys with information are written, in the order in which docs/reference/models.md explains them.
"""

from __future__ import annotations

from dataclasses import fields
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from drivecomm.errors import UsageError
from drivecomm.models.proofs import table_of, without_proofs
from drivecomm.models.schema import FORMAT
from drivecomm.protocol import PanelSetting, ParameterInfo, Watchdog
from drivecomm.tomlfile import toml_line

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from drivecomm.protocol import Model

_ALWAYS_WRITTEN = ("address", "name", "title", "access")
_DEFAULTS = {field.name: field.default for field in fields(ParameterInfo)}
# The dataclass has the order of the page; the sources of a fact come last.
_LAST = ("source", "printed", "second_source", "sure")
_PARAMETER_KEYS = tuple(key for key in _DEFAULTS if key not in (*_LAST, "extra", "proof"))


def model_text(model: Model) -> str:
    """Return a model as the text of a model file; reading it gives an equal model.

    Raises UsageError for a value that no file can hold: one of a protocol's own key that TOML cannot express.
    """
    proofs, model = table_of(model), without_proofs(model)
    head = {"format": FORMAT, "protocol": model.protocol, "name": model.name, "title": model.title}
    head |= {key: text for key in ("source", "link_loss") if (text := getattr(model, key))}
    head |= {"fault_log": list(model.fault_log)} if model.fault_log else {}
    parts = [_lines(head.items())]
    tables: dict[str, Mapping[Any, Any]] = {
        "options": model.options,
        "quantities": model.quantities,
        "watchdog": _said(model.watchdog) if model.watchdog else {},
        "identified_by": model.identified_by,
        "faults": model.faults,
        "warnings": model.warnings,
        "control": model.control,
        "sources": model.sources,
        "proofs": proofs,
    }
    parts += [f"[{name}]\n{_lines(table.items())}" for name, table in tables.items() if table]
    parts += [f"[[setup]]\n{_lines(_said(row).items())}" for row in model.setup]
    parts += [f"[[parameter]]\n{_lines(_parameter(info))}" for info in model.parameters.values()]
    return "\n".join(parts)


def _parameter(info: ParameterInfo) -> Iterator[tuple[str, Any]]:
    for key in _PARAMETER_KEYS:
        value = getattr(info, key)
        # A key without a default has a factory, and its empty table needs no line either.
        if key in _ALWAYS_WRITTEN or (value != _DEFAULTS[key] and value != {}):
            yield key, value
    yield from info.extra.items()
    for key in _LAST:
        if getattr(info, key) != _DEFAULTS[key]:
            yield key, getattr(info, key)


def _said(table: Watchdog | PanelSetting) -> dict[str, Any]:
    """Return the keys of a table that differ from their defaults, in the order of the dataclass."""
    chosen = {field.name: (getattr(table, field.name), field.default) for field in fields(table)}
    return {key: value for key, (value, usual) in chosen.items() if value != usual and value not in ({}, ())}


def _lines(items: Iterable[tuple[Any, Any]]) -> str:
    try:
        return "".join(f"{toml_line(key, _exact(value))}\n" for key, value in items)
    except TypeError as error:
        raise UsageError(f"this cannot be written into a model file: {error}") from error


def _exact(value: Any) -> Any:
    """Return a number that must stay exact as a text."""
    return f"{value:f}" if isinstance(value, Decimal) else value
