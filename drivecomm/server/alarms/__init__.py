"""Alarms of a served plant: rules from its file, states that people acknowledge, and delivery to receivers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
