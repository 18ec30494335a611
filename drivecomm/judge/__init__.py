"""Judge a master: any program that talks to a drive, against a virtual one, through a catalogue of what goes wrong."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
