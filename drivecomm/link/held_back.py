"""What is not sent now, because a late reply to an earlier question could be taken for its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drivecomm.protocol import Exchange


class HeldBack(Exception):  # noqa: N818 - no failure: nothing was sent, and whoever called goes on later
    """A question cannot be told from an earlier one whose reply may still come; others may have the line until then.

    until: when it can be asked. exchange: what is to be carried out then.
    """

    def __init__(self, until: float, exchange: Exchange[Any]) -> None:
        super().__init__(until)
        self.until, self.exchange = until, exchange
