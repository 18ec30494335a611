"""Tables of the page of supported drives, made from the models while mkdocs runs: one for each protocol."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from markdown_tables import code, table

from drivecomm.models import MONITORING_ONLY, load_model, model_names
from drivecomm.protocol import resolve_options

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from drivecomm.protocol import Capabilities, Model, Protocol

PLACE = "reference/supported-drives.md"
MARK = "<!-- tables -->"
"""Placeholder for the tables on the page."""

NEVER_TRIED = "never tried on a drive"

_HEADS = (
    "series", "model", "read", "commanded", "backed up", "fault texts", "panel", "link loss", "name plate",
    "identified by", "how sure", "on a drive",
)  # fmt: skip
_PLATE = ("power", "voltage", "current", "frequency", "speed")
_SURE = {
    "drive": "proved on a drive",
    "printed": "page",
    "derived": "derived",
    "field": "drive or program",
    "unconfirmed": "unconfirmed",
    "imported": "imported",
    "contradicted": "contradicted by a drive",
}


def supported_drives(plugins: Iterable[Protocol]) -> str:
    """Return the tables of all models of these protocols, as Markdown."""
    return "\n\n".join(part for plugin in plugins for part in _of_protocol(plugin))


def _of_protocol(plugin: Protocol) -> Iterator[str]:
    names = model_names(plugin.package, plugin.name)
    if names:
        yield f"## {plugin.title}"
        its_page = f"[its page](protocols/{plugin.name}.md)"
        yield f"Protocol {code(plugin.name)}; parameters, sources and telegrams are on {its_page}."
        yield table(_HEADS, (_row(plugin, load_model(plugin.package, plugin.name, name)) for name in names))


def _row(plugin: Protocol, model: Model) -> tuple[str, ...]:
    _, options = resolve_options(plugin, model, {})
    can = plugin.operations(plugin.addresses[0], options, model).capabilities
    tried = sum(info.sure in ("field", "drive") for info in model.parameters.values())
    return (
        model.title,
        code(model.name),
        f"{_counted(len(model.quantities), 'common name')}, {_counted(len(model.parameters), 'parameter')}",
        _commanded(can),
        _backed_up(model),
        _texts(model),
        _counted(len(model.setup), "setting") if model.setup else "no page",
        _link_loss(model),
        _name_plate(model),
        _identified_by(model),
        _sure(model),
        _counted(tried, "fact") if tried else NEVER_TRIED,
    )


def _commanded(can: Capabilities) -> str:
    if can.monitoring_only:
        return MONITORING_ONLY
    units = [unit for unit, has in (("%", can.reference_percent), ("Hz", can.reference_hz)) if has]
    told = ["yes", *([f"reference in {' and '.join(units)}"] if units else [])]
    return "; ".join([*told, *([] if can.reverse else ["no start backwards"])])


def _backed_up(model: Model) -> str:
    settings = sum(
        info.kind == "setting" and "r" in info.access and "w" in info.access for info in model.parameters.values()
    )
    return _counted(settings, "setting") if settings else "nothing"


def _texts(model: Model) -> str:
    warnings = f", {len(model.warnings)} of warnings" if model.warnings else ""
    return f"{len(model.faults)}{warnings}"


def _link_loss(model: Model) -> str:
    if model.watchdog is not None:
        return "set and read back"
    return "a sentence" if model.link_loss else "unknown"


def _name_plate(model: Model) -> str:
    return ", ".join(each for each in _PLATE if f"motor_rated_{each}" in model.quantities) or "not found"


def _identified_by(model: Model) -> str:
    """Return the keys that identify a drive's model, or the identity that such a drive reports if there is no rule."""
    told = ", ".join(model.control.get("identity", ()))
    return ", ".join(model.identified_by) or (f"no rule; reports {told}" if told else "no rule")


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _sure(model: Model) -> str:
    """Return the number of facts per source quality, and the number with a second source."""
    counted = Counter(info.sure for info in model.parameters.values())
    told = [f"{counted[sure]} {words}" for sure, words in _SURE.items() if counted[sure]]
    if again := sum(bool(info.second_source) for info in model.parameters.values()):
        told.append(f"{again} with a second source")
    if behind := sum(map(len, model.sources.values())):
        told.append(f"{behind} sources of commands and status")
    return ", ".join(told)
