from .door import HttpDoor as HttpDoor, LocalDoor as LocalDoor, http_door as http_door
from .openapi import description as description
