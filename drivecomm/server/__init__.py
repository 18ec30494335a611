"""The process that owns the lines of a plant while it runs, and lets everybody else reach its drives.

What it knows stands in a table of current values; what it is asked to do goes through one place, whoever asks. Doors
(HTTP, and those of other packages) are plug-ins that carry both to the world.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
