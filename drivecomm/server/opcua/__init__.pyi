from .door import OpcuaDoor as OpcuaDoor, opcua_door as opcua_door
