"""A plant: its lines and drives as data, as a file, as opened by a master, and the status of all its drives.

This package describes plants; `drivecomm.plant.files` reads one, `drivecomm.plant.opened` opens it for masters, and
`drivecomm.virtual.virtual_plant` makes virtual drives of it. docs/reference/plant-file.md and
docs/how-to/virtual-plant.md explain the files.
"""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Condition": "TripCondition",
    "Fault": "LineFault",
    "Noise": "LineNoise",
    "Step": "ScriptStep",
    "Window": "FaultWindow",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
