"""The connection to an MQTT broker that doors share: its settings, its identity, connecting and reconnecting.

When a broker returns, the connection is restored within seconds. Two gateways with the same identity do not take it
from each other: the second one is refused, and reports that. Needs the extra named mqtt.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
