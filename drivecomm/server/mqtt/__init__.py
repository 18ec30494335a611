"""The MQTT door: each value as a retained topic, what was missed afterwards, and commands that cannot be replayed.

It needs the extra named mqtt, and is loaded only where a plant file names it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
