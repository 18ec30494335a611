"""Judge of masters: runs any program that talks to a drive against a virtual drive and a catalogue of disturbances."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
