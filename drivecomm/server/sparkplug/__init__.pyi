from .door import SparkplugDoor as SparkplugDoor, sparkplug_door as sparkplug_door
