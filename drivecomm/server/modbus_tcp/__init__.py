"""The Modbus TCP door: each drive is a unit, and its values are registers with the same addresses on every drive.

Modbus TCP has no users and no encryption: any host that reaches the port may read, and only the addresses listed in the
plant file may command. Code that needs pymodbus is imported when a server makes the door, not when the register map is
printed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
