"""The fleet in plain form, for the page and for other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drivecomm.server.fleet.following import FleetSubscription
    from drivecomm.server.fleet.plants import FleetDrive


def fleet_content(following: FleetSubscription) -> dict[str, Any]:
    """Return the summaries of all plants, in plain form, sorted by name."""
    fleet = following.fleet
    summaries = sorted((plant.summary for plant in fleet.plants.values()), key=lambda each: each.name)
    return {
        "prefix": fleet.prefix,
        "problem": following.problem,
        "plants": [each._asdict() for each in summaries],
    }


def plant_content(following: FleetSubscription, name: str) -> dict[str, Any]:
    """Return a plant and its drives, in plain form. Raises KeyError for a plant that has published nothing."""
    plant = following.fleet.plants[name]
    return {
        **plant.summary._asdict(),
        "standing": [each._asdict() for each in plant.alarms],
        "problem": following.problem,
        "list": [drive_content(drive) for drive in plant.shown],
    }


def drive_content(drive: FleetDrive) -> dict[str, Any]:
    """Return a drive in plain form."""
    return {
        "name": drive.name,
        "title": drive.title,
        "drive": drive.drive,
        "line": drive.line,
        "model": drive.model,
        "answers": drive.answers,
        "state": drive.state,
        "fault": drive.fault,
        "values": {name: seen._asdict() for name, seen in drive.values.items()},
    }
