from .alarm import Alarm as Alarm, Transition as Transition
from .delivery import Delivery as Delivery
from .messages import try_out as try_out
from .plant_alarms import PlantAlarms as PlantAlarms, WriteEvent as WriteEvent
from .receivers import Receiver as Receiver, receivers_of as receivers_of
from .rules import AlarmRule as AlarmRule, Limit as Limit, read_alarms as read_alarms
from .states import Alarms as Alarms
