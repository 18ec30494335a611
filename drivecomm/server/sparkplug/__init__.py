"""The Sparkplug B 3.0 door: the plant as an edge node of an MQTT broker, and its drives as devices.

Hosts receive births, deaths and changes in one sequence, and missed values from the history, marked as historical.
Modules that need aiomqtt or protobuf are imported when a door runs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
