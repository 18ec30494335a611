"""The OPC UA door: address space, commands as methods, a lock per drive, events, alarms and history.

The folders and names of a drive's values follow OPC 40400-2, in a namespace of our own; no conformance is claimed.
asyncua implements the protocol. Rights that asyncua gives strangers by default are removed in `connections` and
`sessions`. asyncua is imported when a door runs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
