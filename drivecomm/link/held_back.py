"""Signal that a request must wait, because a late reply to an earlier one could be mistaken for its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drivecomm.protocol import Exchange


class HeldBack(Exception):  # noqa: N818 - not a failure: nothing was sent, and the call continues later
    """Raised for a request that has to wait for a late reply; other calls may use the line until then.

    until: earliest time to send the request. exchange: the exchange to run at that time.
    """

    def __init__(self, until: float, exchange: Exchange[Any]) -> None:
        super().__init__(until)
        self.until, self.exchange = until, exchange
