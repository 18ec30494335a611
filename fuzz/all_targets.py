"""All fuzz targets, by name."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from file_targets import file_targets
from order_target import order_target
from sniffer_target import sniffer_target
from telegram_targets import telegram_targets

from drivecomm.protocol import installed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from target import FuzzTarget


@cache
def all_targets() -> Mapping[str, FuzzTarget]:
    """Return all targets by name; the telegram targets cover the installed protocols."""
    targets = [target for plugin in installed.working() for target in telegram_targets(plugin)]
    targets += [order_target(plugin) for plugin in installed.working()]
    targets += [*file_targets(), sniffer_target()]
    return {target.name: target for target in targets}
