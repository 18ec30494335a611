"""The Modbus TCP door: each drive a unit, its values as registers whose addresses are the same for every drive.

Modbus TCP has no users and no encryption: whoever reaches the port may read, and only addresses that the plant file
lists may command. What needs pymodbus is loaded when a door is made for a server, not where its map is printed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
