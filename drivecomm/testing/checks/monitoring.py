"""Checks of drives that are monitoring only: the master refuses every command."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from drivecomm.errors import NotSupported
from drivecomm.protocol import Stop, resolve_options
from drivecomm.testing.bench import bench
from drivecomm.testing.checking import check, known_model, raise_all

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivecomm.protocol import Model, Protocol


@check("monitoring")
def refuses_every_command(plugin: Protocol, model: Model) -> None:
    """A drive whose model has no commands gets none: each command is refused before anything is sent."""
    wrong = []
    with bench(plugin, model) as on:
        drive = on.drive
        commands: dict[str, Callable[[], object]] = {
            "starting": drive.start,
            "starting backwards": partial(drive.start, reverse=True),
            **{f"stopping by {how.value}": partial(drive.stop, how) for how in Stop},
            "a reset": drive.reset,
            "a reference in hertz": partial(drive.set_reference, hz=10),
            "a reference in per cent": partial(drive.set_reference, percent=10),
        }
        for name, call in commands.items():
            on.virtual.heard.clear()
            try:
                call()
            except NotSupported:
                on.expect_nothing_sent(f"{name} is refused")
            else:
                wrong.append(f"{name} is not refused")
    raise_all(wrong)


def takes_commands(plugin: Protocol, model: str) -> bool:
    """Return whether drives of a model can be started at all; True if the package raises an unexpected error."""
    try:
        known = known_model(plugin, model)
        options = resolve_options(plugin, known, {})[1]
        next(plugin.operations(plugin.addresses[0], options, known).start())
    except NotSupported:
        return False
    except Exception:  # noqa: BLE001 - an unfinished package may raise anything
        return True
    return True
