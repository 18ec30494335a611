"""The connection to an MQTT broker that doors share: its settings, connecting, identity, and reconnecting.

After a broker was away, the connection is restored within seconds of its return. Two gateways with the same identity do
not take it from each other: the second one is refused, and reports that. Needs the extra named mqtt.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
