"""Drive models: what the parameters of one drive series mean, as data with a source, and how it is read and judged.

What they are is here and loads nothing else; files are read by `drivecomm.models.files`, common names are in
`drivecomm.models.quantities`. docs/reference/models.md explains the files.
"""

from drivecomm.models.model import Access as Access
from drivecomm.models.model import Kind as Kind
from drivecomm.models.model import LinkLoss as LinkLoss
from drivecomm.models.model import Model as Model
from drivecomm.models.model import ParameterInfo as ParameterInfo
from drivecomm.models.model import Storage as Storage
from drivecomm.models.model import Sureness as Sureness
from drivecomm.models.model import Watchdog as Watchdog
