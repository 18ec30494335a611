from .alarm import Alarm as Alarm, AlarmTransition as AlarmTransition
from .delivery import AlarmDelivery as AlarmDelivery
from .messages import try_out as try_out
from .plant_alarms import PlantAlarms as PlantAlarms, WriteEvent as WriteEvent
from .receivers import AlarmReceiver as AlarmReceiver, receivers_of as receivers_of
from .rules import AlarmLimit as AlarmLimit, AlarmRule as AlarmRule, read_alarms as read_alarms
from .states import Alarms as Alarms
