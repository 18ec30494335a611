"""What drives do when their master falls silent, in one sentence, from what their model says of it.

Messages, screens and `Capabilities.link_loss` take it from here, so that none of them says anything else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivecomm.protocol import LinkLoss, Model

_DOES: dict[LinkLoss, str] = {
    "hold": "it goes on",
    "ramp": "it stops down its ramp",
    "coast": "it coasts",
    "trip": "it trips",
}
_NOTHING_KNOWN = "no page that was read says what these drives do"


def link_loss_of(model: Model) -> str:
    """Return what drives of this model do when their master falls silent, and which parameters decide it."""
    watchdog = model.watchdog
    if watchdog is None:
        return model.link_loss or _NOTHING_KNOWN
    never = "" if watchdog.off is None else f", never with {watchdog.off}"
    when = f"after the time in {watchdog.time}{never}"
    if not watchdog.action:
        said = f"{_DOES[next(iter(watchdog.actions))]} {when}"
    else:
        does = ", ".join(f"{code} {_DOES[policy]}" for policy, code in watchdog.actions.items())
        said = f"what {watchdog.action} says ({does}), {when}"
    return f"{said}; {watchdog.note}" if watchdog.note else said
