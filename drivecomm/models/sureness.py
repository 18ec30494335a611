"""Counts of how sure the facts of the packaged models are."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from drivecomm.models.files import packaged_models, read_model
from drivecomm.protocol import installed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivecomm.protocol import Model

HEARSAY = frozenset({"vabus/guesses"})
"""Packaged models that list hearsay about drives, for trials on them; these models are not counted."""


def counted_models() -> Iterator[Model]:
    """Yield the packaged models whose facts count, always in the same order.

    Raises FileFormatError for a packaged model that cannot be read.
    """
    for plugin in sorted(installed.working(), key=lambda plugin: plugin.name):
        for path in sorted(packaged_models(plugin.package), key=lambda path: path.stem):
            if f"{plugin.name}/{path.stem}" not in HEARSAY:
                yield read_model(path, plugin.name, plugin.package)


def sureness_of_facts() -> Counter[str]:
    """Return the number of facts in the packaged models by mark; facts that a model takes over count in it, too.

    Facts are parameters and panel settings. Raises FileFormatError for a packaged model that cannot be read.
    """
    marks: Counter[str] = Counter()
    for model in counted_models():
        marks.update(info.sure for info in model.parameters.values())
        marks.update(setting.sure for setting in model.setup)
    return marks
