"""The history of a server: values, events, commands and fault logs in one SQLite file, which outlives the server.

`Journal` writes it, in a separate thread. `History` reads it, even while it is being written, and without a server.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
