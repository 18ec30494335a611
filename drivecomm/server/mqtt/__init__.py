"""The MQTT door: a retained topic per value, late delivery of missed values, and commands that cannot be replayed.

It needs the extra named mqtt, and is imported only if a plant file has such a door.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
