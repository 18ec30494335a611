"""The connection to an MQTT broker that doors share: how it is described, made, kept, and made again.

A broker that goes away is connected again within seconds of its return. Two gateways with the same identity do not take
it from each other: the second one is refused, and says so. It needs the extra named mqtt.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
