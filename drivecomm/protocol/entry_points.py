"""Entry points of the installed distributions, read without importlib.metadata, which takes long to load.

importlib.metadata is used only if modules are searched for in other places than folders, such as a zip file.
"""

from __future__ import annotations

import os
import sys
from functools import reduce
from importlib import import_module
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


class EntryPoint(NamedTuple):
    """Entry point of a distribution.

    value: `module:attribute`.
    """

    name: str
    value: str
    distribution: str

    def load(self) -> Any:
        """Import the module and return the attribute. Raises AttributeError and any error of the module."""
        module, _, attribute = self.value.partition("[")[0].strip().partition(":")
        names = attribute.split(".") if attribute else []
        return reduce(getattr, names, import_module(module))


def later(value: str) -> Callable[..., Any]:
    """Return a function that imports `module:attribute` when it is called, and passes its arguments on.

    A master starts faster this way, since it needs no virtual drive.
    """

    def call(*arguments: Any) -> Any:
        return EntryPoint("", value, "").load()(*arguments)

    return call


def entry_points(group: str) -> list[EntryPoint]:
    """Return all entry points of a group; of two distributions with the same name, the first one found counts."""
    found: list[EntryPoint] = []
    known: set[str] = set()
    if any(hasattr(finder, "find_distributions") for finder in sys.meta_path if finder is not PathFinder):
        return _by_metadata(group)
    for folder in sys.path:
        try:
            with os.scandir(folder or ".") as there:
                names = [each.name for each in there]
        except NotADirectoryError:
            return _by_metadata(group)
        except OSError:
            continue
        if folder.endswith(".egg"):
            return _by_metadata(group)
        for name in names:
            stem, _, kind = name.rpartition(".")
            distribution = stem.partition("-")[0].replace(".", "_").lower()
            if kind in ("dist-info", "egg-info") and distribution not in known:
                known.add(distribution)
                found.extend(_in_distribution(Path(folder, name), group))
    return found


def _in_distribution(folder: Path, group: str) -> Iterator[EntryPoint]:
    try:
        text = Path(folder, "entry_points.txt").read_text(encoding="utf-8")
    except OSError:
        # Most distributions have no entry points.
        return
    section = ""
    for line in map(str.strip, text.splitlines()):
        name, equals, value = line.partition("=")
        if line.startswith("["):
            section = line.strip("[]")
        elif equals and section == group and not line.startswith("#"):
            yield EntryPoint(name.strip(), value.strip(), _name(folder))


def _name(folder: Path) -> str:
    for file in ("METADATA", "PKG-INFO"):
        try:
            lines = Path(folder, file).read_text(encoding="utf-8").splitlines()
        except (OSError, ValueError):
            continue
        for line in lines:
            if line.startswith("Name:"):
                return line.removeprefix("Name:").strip()
    return folder.name.partition("-")[0]


def _by_metadata(group: str) -> list[EntryPoint]:
    from importlib import metadata

    return [
        EntryPoint(entry.name, entry.value, entry.dist.name if entry.dist else "an unknown distribution")
        for entry in metadata.entry_points(group=group)
    ]
