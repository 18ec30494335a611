"""Resource limits per client of the door, so that no client affects the others."""

from __future__ import annotations

from drivecomm.server import Bounds

CONNECTIONS = Bounds(200, 50)
WITHOUT_SESSION_S = 20.0
"""Seconds after which a connection without a login is closed."""

CHUNK = 65_535
SMALLEST_CHUNK = 8_192
"""Minimum chunk size that the specification guarantees; smaller ones would split responses into too many chunks."""
MESSAGE = 2 * 1024 * 1024
UNSENT = 8 * 1024 * 1024
"""Bytes of unread responses at which a client is disconnected."""
WAITING_MESSAGES = 200

CALLS_UNDER_WAY = 20
STOPS_UNDER_WAY = 100
"""Concurrent stop calls; higher than for other calls, so that a stop is still accepted."""
CALLS_AT_ONCE = 100
"""Method calls in one request."""

SHORTEST_SESSION_MS = 5_000.0
LONGEST_SESSION_MS = 300_000.0

SUBSCRIPTIONS = 200
SUBSCRIPTIONS_OF_SESSION = 20
SHORTEST_PUBLISHING_MS = 20.0
LONGEST_PUBLISHING_MS = 60_000.0
UNSERVED_S = 60.0
"""Lifetime in seconds of a subscription without publish requests, unless its publishing interval is longer."""
UNACKNOWLEDGED = 10

ITEMS = 40_000
ITEMS_OF_SESSION = 12_000
EVENT_ITEMS_OF_SESSION = 20
QUEUED_VALUES = 10
QUEUED_EVENTS = 1_000
FILTER_ELEMENTS = 20
FILTER_FIELDS = 500

NODES_AT_ONCE = 10_000
"""Nodes in one read, browse or subscribe request."""
REFERENCES_AT_ONCE = 30_000
"""References in one browse response."""
ANSWER = 4 * 1024 * 1024
"""Bytes of texts and arrays in one read response."""
HISTORIES_AT_ONCE = 20
PAST_VALUES = 1_000
"""Values of one node in one history response; the client continues with the rest."""

VALID_S = 2.0
"""Seconds after which a delayed call no longer commands."""
LOCK_S = 10.0
"""Seconds after which a lock expires unless it is renewed."""
