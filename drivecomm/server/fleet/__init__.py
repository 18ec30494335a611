"""Many plants at a glance: what their servers tell an MQTT broker. It asks no server and commands nothing."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
