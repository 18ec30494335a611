"""A plant: its lines and drives as data, as a file, as opened by a master, and the status of all its drives.

This package describes plants; `drivecomm.plant.files` reads one, `drivecomm.plant.opened` opens it for masters, and
`drivecomm.virtual.virtual_plant` makes virtual drives of it. docs/reference/plant-file.md and
docs/how-to/virtual-plant.md explain the files.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
