"""How sure the facts of the packaged models are, counted."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from drivecomm.models.files import packaged_models, read_model
from drivecomm.protocol import installed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import Model

HEARSAY = frozenset({"vabus/guesses"})
"""Packaged models that list what is only said of drives, to be tried on them: they are not counted."""


def counted_models() -> Iterator[Model]:
    """Yield the packaged models whose facts count, always in the same order.

    Raises FileFormatError for a packaged model that cannot be read.
    """
    for plugin in sorted(installed.working(), key=lambda plugin: plugin.name):
        for path in sorted(packaged_models(plugin.package), key=lambda path: path.stem):
            if f"{plugin.name}/{path.stem}" not in HEARSAY:
                yield read_model(path, plugin.name, plugin.package)


def sureness_of_facts() -> Counter[str]:
    """Return how many facts of the packaged models carry each mark; what a model takes over counts in it, too.

    Facts are parameters and panel settings. Raises FileFormatError for a packaged model that cannot be read.
    """
    marks: Counter[str] = Counter()
    for model in counted_models():
        marks.update(info.sure for info in model.parameters.values())
        marks.update(setting.sure for setting in model.setup)
    return marks
