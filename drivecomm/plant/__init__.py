"""A plant: its lines and drives as data, as a file, as its masters open it, and how all of it is.

What a plant is, is here; `drivecomm.plant.files` reads one, `drivecomm.plant.opened` opens it for masters, and
`drivecomm.virtual.virtual_plant` makes virtual drives of it. docs/reference/plant-file.md and
docs/how-to/virtual-plant.md explain the files.
"""

from drivecomm.plant.plant import LARGEST_CODE as LARGEST_CODE
from drivecomm.plant.plant import PLATE as PLATE
from drivecomm.plant.plant import Condition as Condition
from drivecomm.plant.plant import InjectStep as InjectStep
from drivecomm.plant.plant import Noise as Noise
from drivecomm.plant.plant import Of as Of
from drivecomm.plant.plant import Plant as Plant
from drivecomm.plant.plant import PlantDrive as PlantDrive
from drivecomm.plant.plant import PlantLine as PlantLine
from drivecomm.plant.plant import PlantLinkLoss as PlantLinkLoss
from drivecomm.plant.plant import PlantRead as PlantRead
from drivecomm.plant.plant import PowerCutStep as PowerCutStep
from drivecomm.plant.plant import Step as Step
from drivecomm.plant.plant import StuckStep as StuckStep
from drivecomm.plant.plant import TelegramFault as TelegramFault
from drivecomm.plant.plant import TripStep as TripStep
from drivecomm.plant.plant import Window as Window
from drivecomm.plant.plant import kind_named as kind_named
