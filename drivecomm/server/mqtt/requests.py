"""Requests about the plant as a whole, under bridge/request: stops of all drives, leases, alarms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from drivecomm.client import error_content, plain

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivecomm.server import Caller, Lease, ServedPlant


async def carry_out_request(plant: ServedPlant, caller: Caller, what: str, content: Mapping[str, Any]) -> Any:
    """Carry out a validated request and return its result as plain data. Raises DriveCommError."""
    if what == "stop":
        stopped = await plant.stop_all(caller, content.get("how", "ramp"), content.get("lines", ()))
        return [
            {
                "line": each.line,
                "drive": each.drive,
                "how": each.how.value,
                "outcome": each.answer.outcome,
                "error": None if each.answer.error is None else error_content(each.answer.error),
            }
            for each in stopped
        ]
    if what == "acknowledge":
        return plain(await plant.acknowledge(caller, content["alarm"]))
    drive = content["drive"]
    if what == "lease/take":
        return _lease(await plant.take_lease(caller, drive, float(content["seconds"])))
    if what == "lease/renew":
        return _lease(await plant.renew_lease(caller, drive, content["key"], float(content["seconds"])))
    await plant.end_lease(caller, drive, content["key"])
    return {"drive": drive}


def _lease(lease: Lease) -> dict[str, Any]:
    return {"drive": lease.drive, "holder": lease.holder.name, "until_s": lease.until_s, "key": lease.key}
