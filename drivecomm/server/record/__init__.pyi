from .database import Database as Database
from .opening import open_record as open_record
from .recorder import Recorder as Recorder
from .tables import TABLES as TABLES
