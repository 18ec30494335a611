"""How much one client may take of the door, so that none costs the others anything."""

from __future__ import annotations

from drivecomm.server import Bounds

CONNECTIONS = Bounds(200, 50)
WITHOUT_SESSION_S = 20.0
"""A connection on which nobody logs in is closed then."""

CHUNK = 65_535
SMALLEST_CHUNK = 8_192
"""What the specification lets a client have at least; smaller ones would cut answers into endless pieces."""
MESSAGE = 2 * 1024 * 1024
UNSENT = 8 * 1024 * 1024
"""A client that does not read what it asked for is cut off at so many bytes."""
WAITING_MESSAGES = 200

CALLS_UNDER_WAY = 20
STOPS_UNDER_WAY = 100
"""A stop is let in when other calls are not."""
CALLS_AT_ONCE = 100
"""Method calls in one request."""

SHORTEST_SESSION_MS = 5_000.0
LONGEST_SESSION_MS = 300_000.0

SUBSCRIPTIONS = 200
SUBSCRIPTIONS_OF_SESSION = 20
SHORTEST_PUBLISHING_MS = 20.0
LONGEST_PUBLISHING_MS = 60_000.0
UNSERVED_S = 60.0
"""A subscription whose client asks for no more messages ends then, unless its publishing interval is longer."""
UNACKNOWLEDGED = 10

ITEMS = 40_000
ITEMS_OF_SESSION = 12_000
EVENT_ITEMS_OF_SESSION = 20
QUEUED_VALUES = 10
QUEUED_EVENTS = 1_000
FILTER_ELEMENTS = 20
FILTER_FIELDS = 500

NODES_AT_ONCE = 10_000
"""Nodes in one request to read, browse or subscribe."""
REFERENCES_AT_ONCE = 30_000
"""References in one answer to a request to browse."""
ANSWER = 4 * 1024 * 1024
"""Bytes of texts and arrays in one answer to a request to read."""
HISTORIES_AT_ONCE = 20
PAST_VALUES = 1_000
"""Values of one node in one answer; the rest follows."""

VALID_S = 2.0
"""A call that has waited longer commands nothing."""
LOCK_S = 10.0
"""A lock that is not renewed ends then."""
