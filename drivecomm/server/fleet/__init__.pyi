from .acknowledging import acknowledged as acknowledged
from .content import drive_content as drive_content, fleet_content as fleet_content, plant_content as plant_content
from .following import Following as Following
from .page import fleet_page as fleet_page
from .past_pages import PastPages as PastPages
from .plants import (
    Fleet as Fleet,
    FleetAlarm as FleetAlarm,
    FleetDrive as FleetDrive,
    FleetPlant as FleetPlant,
    Summary as Summary,
)
