"""Link-loss policies with which a server can start a drive, and the check of the policy in a plant file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.bus import policies

if TYPE_CHECKING:
    from drivecomm.protocol import DriveConfig, LinkLoss, Model


def policies_to_start_with(model: Model | None) -> tuple[LinkLoss, ...]:
    """Return the link-loss policies with which drives of a model can be started; every drive supports hold."""
    return tuple(dict.fromkeys(("hold", *policies(model))))


def wrong_policy(config: DriveConfig, model: Model | None) -> str:
    """Return the reason why a drive cannot be started with its policy in the plant file, empty if it can."""
    said, able = config.link_loss, policies_to_start_with(model)
    if said is None or said.policy in able:
        return ""
    why = "whose model is not known" if model is None else f"a drive of model {model.name}"
    return (
        f"{config.name}, {why}, cannot be started with the link_loss policy {said.policy} of the plant file; "
        f"write {' or '.join(able)} there"
    )
