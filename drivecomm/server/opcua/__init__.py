"""The OPC UA door: the plant as an address space, with commands as methods, a lock for each drive, events and history.

Folders and names of a drive's values follow OPC 40400-2 in a namespace of our own; no conformance is claimed. asyncua
speaks the protocol; what it would let strangers do by default is taken away here, in `connections` and `sessions`. It
is loaded when a door runs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
