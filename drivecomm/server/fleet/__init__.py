"""An overview of many plants, from what their servers publish to an MQTT broker; sends no commands to motors."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
