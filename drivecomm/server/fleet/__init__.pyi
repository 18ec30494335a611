from .acknowledging import acknowledge_over_broker as acknowledge_over_broker
from .content import drive_content as drive_content, fleet_content as fleet_content, plant_content as plant_content
from .following import FleetSubscription as FleetSubscription
from .page import fleet_page as fleet_page
from .past_pages import RecordPages as RecordPages
from .plants import (
    Fleet as Fleet,
    FleetAlarm as FleetAlarm,
    FleetDrive as FleetDrive,
    FleetPlant as FleetPlant,
    PlantSummary as PlantSummary,
)
