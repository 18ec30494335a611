from .database import Database as Database
from .layout import Layout as Layout
from .opening import open_record as open_record
from .past import Past as Past, RecordedValue as RecordedValue, Stretch as Stretch
from .recorder import Recorder as Recorder
from .tables import TABLES as TABLES
