"""How sure the facts of the packaged models are, counted."""

from __future__ import annotations

from collections import Counter

from drivecomm.models.files import packaged_models, read_model
from drivecomm.protocol import installed

HEARSAY = frozenset({"vabus/guesses"})
"""Packaged models that list what is only said of drives, to be tried on them: they are not counted."""


def sureness_of_facts() -> Counter[str]:
    """Return how many parameters of the packaged models carry each mark; what a model takes over counts in it, too.

    Raises FileFormatError for a packaged model that cannot be read.
    """
    return Counter(
        info.sure
        for plugin in installed.working()
        for path in packaged_models(plugin.package)
        if f"{plugin.name}/{path.stem}" not in HEARSAY
        for info in read_model(path, plugin.name, plugin.package).parameters.values()
    )
