"""Replacement for asyncua's subscriptions: limited intervals and lifetimes, and our own monitored items."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.server.subscription_service import SubscriptionService

from drivecomm.server.opcua import limits
from drivecomm.server.opcua.monitored import Items

if TYPE_CHECKING:
    from collections.abc import Iterator


class Subscriptions(SubscriptionService):
    """Subscriptions of all sessions, with limited intervals and lifetimes."""

    async def create_subscription(
        self,
        params: ua.CreateSubscriptionParameters,
        callback: Any,
        session_id: ua.NodeId,
        request_callback: Any = None,
    ) -> ua.CreateSubscriptionResult:
        """Create a subscription within the limits.

        asyncua accepts any interval; with an interval of 0 it sends each change immediately and never expires.
        """
        wished = params.RequestedPublishingInterval
        # NaN gives the shortest interval.
        interval_ms = min(max(wished, limits.SHORTEST_PUBLISHING_MS), limits.LONGEST_PUBLISHING_MS)
        interval_ms = interval_ms if interval_ms == interval_ms else limits.SHORTEST_PUBLISHING_MS  # noqa: PLR0124
        params.RequestedPublishingInterval = ua.Duration(interval_ms)
        longest = max(3, int(limits.UNSERVED_S * 1000 / interval_ms))
        lifetime = min(params.RequestedLifetimeCount or longest, longest)
        params.RequestedLifetimeCount = ua.Counter(max(3, lifetime))
        keep_alive = min(params.RequestedMaxKeepAliveCount or lifetime, max(1, lifetime // 3))
        params.RequestedMaxKeepAliveCount = ua.Counter(keep_alive)
        result = await super().create_subscription(params, callback, session_id, request_callback)
        made = self.subscriptions[result.SubscriptionId]
        made.monitored_item_srv = Items(made, self.aspace)  # type: ignore[assignment]
        return result

    def listening(self, session: ua.NodeId | None = None) -> Iterator[tuple[int, Items]]:
        """Yield the subscriptions of a session, or of all, with their ids and items."""
        for number, each in list(self.subscriptions.items()):
            # Subscriptions of the server itself have items of asyncua.
            if session in (None, each.session_id) and isinstance(each.monitored_item_srv, Items):
                yield number, each.monitored_item_srv
