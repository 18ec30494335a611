from .door import MqttDoor as MqttDoor, mqtt_door as mqtt_door
from .topics import (
    AVAILABILITY as AVAILABILITY,
    BRIDGE as BRIDGE,
    INFO as INFO,
    STATE as STATE,
    VALUES as VALUES,
    Topics as Topics,
    name_of as name_of,
)
