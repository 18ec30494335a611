from .database import Database as Database
from .layout import Layout as Layout
from .opening import open_record as open_record
from .record_queries import RecordedValue as RecordedValue, RecordQueries as RecordQueries, TimePeriod as TimePeriod
from .recorder import BrokerRecorder as BrokerRecorder
from .tables import TABLES as TABLES
