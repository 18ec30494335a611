"""Page of a protocol, made from its package while mkdocs runs.

It contains only data of the package: schemas, options, facts, capabilities, vectors, models, and its README. Protocols
from third parties get their pages in the same way.
"""

from __future__ import annotations

import inspect
import logging
import re
import tomllib
from dataclasses import MISSING, fields
from importlib import resources
from typing import TYPE_CHECKING, Any

from markdown_tables import code, table

from drivecomm.errors import FileFormatError
from drivecomm.models import load_model, model_names, quantities
from drivecomm.protocol import SETTING_NAMES, Stop
from drivecomm.testing import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from drivecomm.protocol import Model, ParameterInfo, Protocol

_LOG = logging.getLogger("mkdocs.hooks.protocols")
_DRAWING_WIDTH = 96
_LABEL_WIDTH = 14


def overview(plugins: list[Protocol]) -> str:
    """Return the page that lists the protocols, as Markdown."""
    rows = (
        (
            f"[{plugin.title}]({plugin.name}.md)",
            code(plugin.name),
            f"{plugin.addresses[0]} to {plugin.addresses[-1]}",
            str(plugin.facts.settings),
            ", ".join(map(code, plugin.parameter_examples)),
            ", ".join(map(code, model_names(plugin.package, plugin.name))),
        )
        for plugin in plugins
    )
    heads = ("protocol", "name", "addresses", "default line settings", "parameters like", "models")
    text = "These pages are made from the packages: from the schemas that read and write the telegrams, "
    text += "from the model files and from the vectors. `drivecomm protocols` prints the same table in short."
    return f"# Protocols\n\n{text}\n\n{table(heads, rows)}\n"


def protocol_page(plugin: Protocol) -> str:
    """Return the page of one protocol as Markdown."""
    parts = [
        f"# {plugin.title}",
        f"In commands and programs this protocol is called `{plugin.name}`.",
        *_readme(plugin),
        "## Line and timing",
        *_facts(plugin),
        "## Capabilities and verbs",
        *_capabilities(plugin),
        "## Options of a drive",
        *_options(plugin),
        "## Telegrams, drawn",
        "Each box is a field, with the positions of its characters above it; `n` is a length given by another field.",
        *_telegrams(plugin),
        "## Telegrams printed in manuals",
        *_printed(plugin),
        "## Model tables",
        *_models(plugin),
    ]
    return "\n\n".join(parts) + "\n"


def drawing(rows: Iterable[tuple[str, str, str]]) -> str:
    """Return a telegram as boxes in text, with character positions above each box."""
    bands: list[list[tuple[str, str]]] = [[]]
    at: int | None = 1
    for name, size, meaning in rows:
        length = int(size) if size.isdigit() else None
        if at is None:
            place = "..."
        elif length is None:
            place = f"{at}..."
        else:
            place = f"{at}" if length == 1 else f"{at}-{at + length - 1}"
        at = None if at is None or length is None else at + length
        box = (place, name or _short(meaning))
        if sum(_box_width(*each) + 1 for each in [*bands[-1], box]) > _DRAWING_WIDTH:
            bands.append([])
        bands[-1].append(box)
    return "\n".join(line for band in bands for line in _band(band))


def _band(boxes: list[tuple[str, str]]) -> list[str]:
    widths = [_box_width(*box) for box in boxes]
    rule = "+" + "+".join("-" * width for width in widths) + "+"
    places = " " + " ".join(place.center(width) for (place, _), width in zip(boxes, widths, strict=True))
    labels = "|" + "|".join(label.center(width) for (_, label), width in zip(boxes, widths, strict=True)) + "|"
    return [places.rstrip(), rule, labels, rule]


def _box_width(place: str, label: str) -> int:
    return max(len(place), len(label)) + 2


def _short(meaning: str) -> str:
    """Return a box's label for a field without a name: the first words of its meaning."""
    label = re.split(r"[:,]", meaning)[0].strip()
    return label if len(label) <= _LABEL_WIDTH else label.split()[0]


def _readme(plugin: Protocol) -> Iterator[str]:
    """Yield the package's README below the page's own title, without links that do not work from this page."""
    try:
        text = (resources.files(plugin.package) / "README.md").read_text(encoding="utf-8")
    except OSError:
        return
    text = re.sub(r"\A\s*# [^\n]*\n", "", text)
    text = re.sub(r"\[([^\]]*)\]\((?!https?://|#)[^)]*\)", r"\1", text)
    yield text.strip()


def _facts(plugin: Protocol) -> Iterator[str]:
    settings, timing = plugin.facts.settings, plugin.facts.timing
    said = plugin.line_sources
    of_line = ", ".join(dict.fromkeys(said[name] for name in SETTING_NAMES if name in said))
    rows = [("line", str(settings), of_line), ("addresses", f"{plugin.addresses[0]} to {plugin.addresses[-1]}", "")]
    timed = [(field.name, getattr(timing, field.name)) for field in fields(timing)]
    rows += [(code(name), f"{value:g}", said.get(name, "")) for name, value in timed]
    yield table(("fact", "default", "required by"), rows)
    yield f"Sources: {plugin.facts_source}."


def _capabilities(plugin: Protocol) -> Iterator[str]:
    operations = plugin.operations(plugin.addresses[0], plugin.options(), None)
    can = operations.capabilities
    rows = []
    for field in fields(can):
        value = getattr(can, field.name)
        if isinstance(value, frozenset):
            value = ", ".join(code(how.value) for how in Stop if how in value)
        rows.append((code(field.name), {True: "yes", False: "no", None: ""}.get(value, str(value))))
    yield table(("capability", "with default options"), rows)
    yield "Options of `read` and `write` beyond those of every protocol:"
    verbs = [(verb, getattr(operations, verb)) for verb in ("read", "write")]
    yield table(("verb", "options", "meaning"), ((code(name), _keywords(verb), _doc(verb)) for name, verb in verbs))
    if operations.extra:
        yield "Verbs of this protocol alone, for `Drive.call` and `drivecomm call`:"
        verbs = list(operations.extra.items())
        yield table(("verb", "arguments", "meaning"), ((code(name), _all(verb), _doc(verb)) for name, verb in verbs))


def _keywords(verb: Any) -> str:
    parameters = inspect.signature(verb).parameters.values()
    return ", ".join(code(one.name) for one in parameters if one.kind is one.KEYWORD_ONLY and one.name != "store")


def _all(verb: Any) -> str:
    return ", ".join(code(name) for name in inspect.signature(verb).parameters)


def _doc(verb: Any) -> str:
    return inspect.getdoc(verb) or ""


def _options(plugin: Protocol) -> Iterator[str]:
    known = fields(plugin.options)
    text = inspect.getdoc(plugin.options) or ""
    names = "|".join(sorted((field.name for field in known), key=len, reverse=True))
    if names:
        text = re.sub(rf"(?<![\w`.])({names})(?=[:,])", r"`\1`", text)
    yield text
    if known:
        example = f"`{plugin.name}:{plugin.addresses[0]},{known[0].name}={_given(known[0].default)}`"
        yield f"They are keywords of `Bus.drive` and `virtual_drive`; in commands they follow its name: {example}."
        rows = ((code(field.name), code(field.type), code(_default(field))) for field in known)
        yield table(("option", "type", "default"), rows)


def _default(field: Any) -> str:
    return "" if field.default is MISSING else repr(field.default)


def _given(default: object) -> str:
    return str(default).lower() if isinstance(default, bool) else str(default)


def _telegrams(plugin: Protocol) -> Iterator[str]:
    for title, form in plugin.forms().items():
        rows = form.describe()
        yield f"### {title}"
        yield f"```text\n{drawing(rows)}\n```"
        yield table(("field", "characters", "meaning"), ((code(name) if name else "", *rest) for name, *rest in rows))


def _printed(plugin: Protocol) -> Iterator[str]:
    try:
        vectors = [vector for vector in packaged_vectors(plugin).vectors if vector.printed and vector.valid]
    except FileFormatError as error:
        _LOG.warning("no vectors of the protocol %s: %s", plugin.name, error)
        return
    if not vectors:
        yield "No manual that we have prints a telegram byte by byte."
        return
    yield "Every byte of these is printed in the document named; the tests decode them and build them again."
    rows = (
        (code(vector.data.hex(" ").upper()), vector.direction, ", ".join(f"{k} {v}" for k, v in vector.fields.items()),
         vector.source)
        for vector in vectors
    )  # fmt: skip
    yield table(("telegram", "direction", "fields", "source"), rows)


def _models(plugin: Protocol) -> Iterator[str]:
    names = model_names(plugin.package, plugin.name)
    if not names:
        yield "None."
    for name in names:
        model = load_model(plugin.package, plugin.name, name)
        base = tomllib.loads((resources.files(plugin.package) / "models" / f"{name}.toml").read_text(encoding="utf-8"))
        yield from _model(plugin, model, base.get("extends"))


def _model(plugin: Protocol, model: Model, extends: str | None) -> Iterator[str]:
    yield f"### {model.title}: `{model.name}`"
    if model.source:
        yield f"Source: {model.source}."
    base = load_model(plugin.package, plugin.name, extends) if extends else None
    if base:
        yield f"It has all parameters of `{extends}`."
    if model.options:
        yield "Options that it sets: " + ", ".join(code(f"{key} = {value!r}") for key, value in model.options.items())
    yield from _identification(model)
    yield from _common_names(model, base)
    yield from _watchdog(model, base)
    own = [info for address, info in model.parameters.items() if base is None or base.parameters.get(address) != info]
    if own:
        heads = ("parameter", "name", "meaning", "type", "unit", "factor", "access", "range", "source", "how sure")
        yield table(heads, map(_parameter, own))
    if model.faults and (base is None or model.faults != base.faults):
        yield "Fault texts: " + ", ".join(f"{code} {text}" for code, text in sorted(model.faults.items())) + "."
    if model.warnings and (base is None or model.warnings != base.warnings):
        yield "Warning texts: " + ", ".join(f"{code} {text}" for code, text in sorted(model.warnings.items())) + "."


def _identification(model: Model) -> Iterator[str]:
    if model.identified_by:
        rules = ", ".join(f"{name} {code(pattern)}" for name, pattern in model.identified_by.items())
        yield f"A drive is recognised as this model by its identification: {rules} (regular expressions)."


def _common_names(model: Model, base: Model | None) -> Iterator[str]:
    """Yield the common names of a model that its base model lacks or has at another address."""
    own = {name: at for name, at in model.quantities.items() if base is None or base.quantities.get(name) != at}
    if not own:
        if model.quantities and base:
            yield f"Its common names are those of `{base.name}`."
        return
    yield "Common names, which are read and written in the unit that the quantity has on every drive:"
    known = quantities()
    rows = (
        (code(name), known[name].unit, known[name].meaning, code(own[name]), _sureness(model, own[name]))
        for name in known
        if name in own
    )
    yield table(("common name", "unit", "meaning", "parameter", "how sure"), rows)


def _sureness(model: Model, address: str) -> str:
    info = model.find(address) or model.find(address.partition("[")[0])
    return info.sure if info else ""


def _watchdog(model: Model, base: Model | None) -> Iterator[str]:
    watchdog = model.watchdog
    if watchdog is None or (base is not None and base.watchdog == watchdog):
        return
    yield "When its master falls silent:"
    actions = "; ".join(
        f"{policy}: {code(f'{watchdog.action} = {number}')}" if watchdog.action else policy
        for policy, number in watchdog.actions.items()
    )
    off = f"{code(f'{watchdog.time} = {watchdog.off}')}" if watchdog.off is not None else "by the action for hold"
    rows = [("time, in seconds", code(watchdog.time)), ("policies", actions), ("switched off", off)]
    rows += [("note", watchdog.note), ("source", watchdog.source), ("how sure", watchdog.sure)]
    yield table(("watchdog", ""), [row for row in rows if row[1]])


def _parameter(info: ParameterInfo) -> tuple[str, ...]:
    meaning = info.title + "".join(f"; {code} = {text}" for code, text in info.values.items())
    limits = "" if info.minimum is None and info.maximum is None else f"{info.minimum} to {info.maximum}"
    plain = (info.type, info.unit, "" if info.factor == 1 else str(info.factor), info.access)
    return (code(info.address), code(info.name), meaning, *plain, limits, info.source, info.sure)
