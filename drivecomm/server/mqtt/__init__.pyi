from .content import object_in as object_in
from .door import MqttDoor as MqttDoor, mqtt_door as mqtt_door
from .topics import (
    ALARMS as ALARMS,
    AVAILABILITY as AVAILABILITY,
    BRIDGE as BRIDGE,
    INFO as INFO,
    OF_DRIVE as OF_DRIVE,
    STATE as STATE,
    VALUES as VALUES,
    Topics as Topics,
    level as level,
    name_of as name_of,
    plant_name as plant_name,
)
