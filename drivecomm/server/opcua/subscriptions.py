"""Subscriptions in place of asyncua's own: with intervals and lifetimes within limits, and items of ours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.server.subscription_service import SubscriptionService

from drivecomm.server.opcua import limits
from drivecomm.server.opcua.monitored import Items

if TYPE_CHECKING:
    from collections.abc import Iterator


class Subscriptions(SubscriptionService):
    """The subscriptions of all sessions, with intervals and lifetimes within limits."""

    async def create_subscription(
        self,
        params: ua.CreateSubscriptionParameters,
        callback: Any,
        session_id: ua.NodeId,
        request_callback: Any = None,
    ) -> ua.CreateSubscriptionResult:
        """Begin one. asyncua takes any interval: none at all lets each change be sent at once, and never expires."""
        wished = params.RequestedPublishingInterval
        # What is no number is the shortest.
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
        """Yield the subscriptions of a session, or all, by their numbers, with what each listens to."""
        for number, each in list(self.subscriptions.items()):
            # What the server itself listens to has items of asyncua's own.
            if session in (None, each.session_id) and isinstance(each.monitored_item_srv, Items):
                yield number, each.monitored_item_srv
