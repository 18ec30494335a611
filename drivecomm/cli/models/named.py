"""Model names on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from drivecomm.errors import UsageError
from drivecomm.models import load_model, model_paths, open_model_file
from drivecomm.protocol import installed

if TYPE_CHECKING:
    from drivecomm.protocol import Model


def model_named(text: str, protocol: str | None) -> Model:
    """Return the model with this NAME, PROTOCOL/NAME or .toml file. Raises UsageError."""
    if text.endswith(".toml"):
        given = protocol or open_model_file(Path(text)).content.get("protocol")
        if not isinstance(given, str):
            raise UsageError(f"{text} does not say which protocol it is for; name one with --protocol")
        return load_model(installed[given].package, given, text)
    before, slash, name = text.rpartition("/")
    if slash and protocol not in (None, before):
        raise UsageError(f"{text} is a model of {before}, and --protocol says {protocol}; leave one of them out")
    if slash or protocol:
        plugin = installed[before or str(protocol)]
        return load_model(plugin.package, plugin.name, name)
    having = [plugin for plugin in installed.working() if name in model_paths(plugin.package, plugin.name)]
    if not having:
        raise UsageError(f"no protocol has a model {name!r}; drivecomm models list shows them, or name a .toml file")
    if len(having) > 1:
        named = " and ".join(f"{plugin.name}/{name}" for plugin in having)
        raise UsageError(f"{name!r} is the name of several models: write {named}")
    return load_model(having[0].package, having[0].name, name)
