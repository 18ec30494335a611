"""The server process: it owns the lines of a plant while it runs and gives other programs access to the drives.

Current values are stored in one table, and every command takes the same path, whichever door it comes from. Doors
(HTTP, and those of other packages) are plug-ins that offer both to clients.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
