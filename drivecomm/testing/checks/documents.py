"""Checks of a protocol package's documents: its coverage, and a source for every fact."""

from __future__ import annotations

import dataclasses
import inspect
import re
from importlib import resources
from typing import TYPE_CHECKING

from drivecomm.models import check_model, model_names, packaged_models
from drivecomm.protocol import LINE_FACT_NAMES
from drivecomm.testing.checking import check, expect, known_model, raise_all
from drivecomm.testing.vectors import packaged_vectors

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Protocol
    from drivecomm.testing.exchange_vectors import ExchangeVector
    from drivecomm.testing.vectors import Vector

_A_DOCUMENT = re.compile(
    r"\b(manual|guide|description|instructions?|specification|standard|handbook|document)s?\b", re.IGNORECASE
)
_A_PLACE = re.compile(r"\b(p|page|pages|section|sections|chapter|table|printed page)\b\.?|\d+-\d+", re.IGNORECASE)


@check("documents")
def has_a_readme(plugin: Protocol) -> None:
    """The README of the package names the documents that the protocol is taken from, with pages or sections."""
    readme = resources.files(plugin.package) / "README.md"
    expect(readme.is_file(), f"{plugin.package} has no README.md")
    text = readme.read_text(encoding="utf-8")
    expect(len(text.split()) >= 50, "the README is almost empty")
    expect(_A_DOCUMENT.search(text), "the README names no manual or other document")
    expect(_A_PLACE.search(text), "the README names no page or section")


@check("documents")
def names_the_source_of_its_facts(plugin: Protocol) -> None:
    """Line settings and timing name their source, which quotes the baud rate and the character format."""
    expect(len(plugin.facts_source.split()) >= 3, f"the source of the line facts is {plugin.facts_source!r}")
    settings = plugin.facts.settings
    for fact in (f"{settings.baudrate}", f"{settings.bytesize}{settings.parity}{settings.stopbits:g}"):
        expect(fact in plugin.facts_source, f"the line is {settings}, and the source of its facts does not say {fact}")
    for fact, source in plugin.line_sources.items():
        expect(fact in LINE_FACT_NAMES | {"silence_characters"}, f"line_sources names {fact}, which is not a line fact")
        expect(len(source.split()) >= 2, f"the source of {fact} is {source!r}; name the document and the page")


@check("documents")
def has_a_source_for_every_vector(plugin: Protocol) -> None:
    """Every telegram and every exchange names its source."""
    file = packaged_vectors(plugin)
    expect(file.vectors, "there are no vectors")
    entries: tuple[Vector | ExchangeVector, ...] = (*file.vectors, *file.exchanges)
    raise_all([f"{each.id} has no source" for each in entries if not each.source.strip()])


@check("documents")
def has_vectors_for_everything(plugin: Protocol) -> None:
    """There are vectors for both directions, for invalid telegrams, and for every form that the protocol declares."""
    file = packaged_vectors(plugin)
    directions = {vector.direction for vector in file.vectors if vector.valid}
    expect(directions == {"request", "reply"}, f"only {sorted(directions)} have vectors")
    expect(any(not vector.valid for vector in file.vectors), "no vector must be refused")
    raise_all(
        [
            f"no vector is a telegram of the form {title!r}"
            for title, form in plugin.forms().items()
            if not any(_reads(form.parse_declared, vector.data) for vector in file.vectors)
        ]
    )


def _reads(parse: Callable[[bytes], object], data: bytes) -> bool:
    try:
        parse(data)
    except Exception:  # noqa: BLE001 - any exception means another form
        return False
    return True


@check("documents")
def has_a_source_for_every_parameter(plugin: Protocol) -> None:
    """Every parameter of every model has a source, its own or its model's."""
    models = {name: known_model(plugin, name) for name in model_names(plugin.package, plugin.name)}
    raise_all(
        [
            f"parameter {info.address} of model {name} has no source"
            for name, model in models.items()
            for info in model.parameters.values()
            if not (info.source.strip() or model.source.strip())
        ]
    )


@check("documents")
def has_models_in_order(plugin: Protocol) -> None:
    """Every model file of the package passes `drivecomm models check`."""
    raise_all([str(finding) for path in packaged_models(plugin.package) for finding in check_model(path, plugin)])


@check("documents")
def explains_its_options(plugin: Protocol) -> None:
    """The docstring of the options explains each option, and the module of the options has a docstring."""
    text = inspect.getdoc(plugin.options) or ""
    raise_all(
        [
            f"the option {field.name} is not explained"
            for field in dataclasses.fields(plugin.options)
            if not re.search(rf"\b{re.escape(field.name)}\b", text)
        ]
    )
    module = inspect.getmodule(plugin.options)
    expect(module is not None and inspect.getdoc(module), "the module of the options has no docstring")
