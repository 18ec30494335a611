"""Reference of the Python API: the names on each page; mkdocstrings adds their descriptions.

A name appears once: on the page of `drivecomm` if it is exported there, otherwise on the page of its room. The errors
have a separate page.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pkgutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

ROOMS = (
    "errors",
    "protocol",
    "bus",
    "line",
    "transport",
    "capture",
    "models",
    "plant",
    "commissioning",
    "virtual",
    "traffic",
    "testing",
)
"""Modules that users and authors of protocol packages import, in addition to `drivecomm` itself."""
TOP = "drivecomm"


def api_pages() -> dict[str, str]:
    """Return the pages as Markdown, by module name."""
    return {name: "\n\n".join(_page(name)) + "\n" for name in (TOP, *(f"{TOP}.{room}" for room in ROOMS))}


def names_of(module: ModuleType) -> list[str]:
    """Return the public names of a module or package, sorted."""
    if hasattr(module, "__all__"):
        return sorted(name for name in module.__all__ if not name.startswith("_"))
    own = TOP if hasattr(module, "__path__") else module.__name__
    return sorted(
        name
        for name, value in vars(module).items()
        if not name.startswith("_") and getattr(value, "__module__", "").startswith(own)
    )


def modules_of(name: str) -> Iterator[ModuleType]:
    """Yield a room and its packages that export names of their own; for `drivecomm` only the module itself."""
    module = importlib.import_module(name)
    yield module
    if name != TOP:
        for below in pkgutil.iter_modules(getattr(module, "__path__", ()), f"{name}."):
            if below.ispkg:
                yield from (inner for inner in modules_of(below.name) if names_of(inner))


def place_of(module: ModuleType, name: str) -> str:
    """Return the import path of a name for mkdocstrings: within its own module if that has the same name."""
    place = f"{module.__name__}.{name}"
    return f"{place}.{name}" if hasattr(module, "__path__") and importlib.util.find_spec(place) else place


def _page(name: str) -> Iterator[str]:
    top, errors = importlib.import_module(TOP), importlib.import_module(f"{TOP}.errors")
    for module in modules_of(name):
        yield f"{'#' if module.__name__ == name else '##'} {module.__name__}"
        yield inspect.getdoc(module).partition("\n\n")[0]
        names = names_of(module)
        elsewhere: list[str] = []
        if module is top:
            elsewhere = _also_in(errors, module, names)
            yield f"Its errors stand [on a page of their own]({TOP}.errors.md): {_links(errors, elsewhere)}."
        elif module is not errors and (elsewhere := _also_in(top, module, names)):
            yield f"Also exported by [`{TOP}`]({TOP}.md), and described there: {_links(top, elsewhere)}."
        yield from (f"::: {place_of(module, each)}" for each in names if each not in elsewhere)


def _also_in(other: ModuleType, module: ModuleType, names: list[str]) -> list[str]:
    there = set(names_of(other))
    return [name for name in names if name in there and getattr(other, name) is getattr(module, name)]


def _links(module: ModuleType, names: list[str]) -> str:
    return ", ".join(f"[`{name}`][{module.__name__}.{name}]" for name in names)
