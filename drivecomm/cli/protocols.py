"""The protocols command."""

from __future__ import annotations

from drivecomm.cli.options import Json
from drivecomm.cli.output import complain, emit, say
from drivecomm.models import model_names
from drivecomm.protocol import installed


def protocols(json: Json = False) -> int:
    """List the installed protocols with their defaults and models."""
    broken = installed.broken()
    for name in installed:
        if name in broken:
            complain(broken[name], as_json=json)
            continue
        plugin = installed[name]
        facts = plugin.facts
        if json:
            emit(
                protocol=name,
                title=plugin.title,
                addresses=[plugin.addresses.start, plugin.addresses.stop - 1],
                broadcast=plugin.broadcast_address,
                line=str(facts.settings),
                reply_timeout_s=facts.timing.reply_timeout_s,
                models=model_names(plugin.package, plugin.name),
                parameters=list(plugin.parameter_examples),
            )
            continue
        span = f"{plugin.addresses.start}-{plugin.addresses.stop - 1}"
        say(f"{name:<11} {plugin.title}")
        say(f"{'':<11} addresses {span}, {facts.settings}, parameters like {', '.join(plugin.parameter_examples)}")
        say(f"{'':<11} models {', '.join(model_names(plugin.package, plugin.name)) or 'none'}")
    return 2 if broken else 0
