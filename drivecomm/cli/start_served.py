"""Start of a motor through the server that owns its line; the server keeps the motor while this command runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.cli.signals import until_stopped
from drivecomm.client import ServedStart, error_of
from drivecomm.errors import DriveError, ServerLostError
from drivecomm.protocol import exact

if TYPE_CHECKING:
    from collections.abc import Callable
    from threading import Event

    from drivecomm.bus import KeepReports
    from drivecomm.client import ServedDrive
    from drivecomm.protocol import LinkLoss


def start_and_stay(
    drive: ServedDrive, news_of: Callable[[Event], KeepReports], policy: LinkLoss, watchdog_s: str, **choices: Any
) -> int:
    """Start a motor, and stay until Ctrl-C or until the server no longer keeps it; return the exit code.

    choices: reference and direction. Events are shown in the same way as without a server.
    """
    ended = ""
    silence_s = exact(watchdog_s, "watchdog time")
    with until_stopped() as stop, ServedStart(drive, float(silence_s)) as kept:
        news = news_of(stop)
        kept.start(policy, watchdog_s=silence_s, **choices)
        for event in kept.events(stop):
            ended = event["done"]
            if "error" in event:
                error = error_of(event["error"])
                if ended == "failed":
                    raise error
                news.failed(error)
                continue
            news.fault = news.fault or ended == "fault"
            said = {"watchdog_s": watchdog_s} if "watchdog_s" in event else {}
            news.tell(**{**event, **said})
    if ended != "stop commanded":
        raise ServerLostError(f"{drive.name}: its server no longer keeps it, for an unknown reason; look at the motor")
    return DriveError.exit_code if news.fault else 0
