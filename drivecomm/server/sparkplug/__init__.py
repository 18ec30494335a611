"""The Sparkplug B 3.0 door: the plant as an edge node of an MQTT broker, and its drives as devices.

Hosts get births, deaths and what has changed, in one sequence, and what they missed from the history, marked as such.
What needs aiomqtt or protobuf is loaded when a door runs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
