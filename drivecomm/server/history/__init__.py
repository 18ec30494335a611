"""The history of a server: values, events, commands and fault logs in one SQLite file, which outlives the server.

`HistoryWriter` writes it in a separate thread; `History` reads it, also meanwhile, with or without a server.
"""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Journal": "HistoryWriter",
    "Point": "CoursePoint",
    "Quantity": "StoredQuantity",
    "Store": "HistoryFile",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
