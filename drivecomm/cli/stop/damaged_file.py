"""Plant files for stopping; as much as possible is read of a damaged file."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.plant import Plant


def readable_plant(path: Path) -> tuple[Plant, list[str]]:
    """Return the readable part of a plant file, and the faults of the file as sentences.

    Without sentences, the plant is complete. Raises FileFormatError if nothing can be read.
    """
    # Imported late, because only calls with a plant file need it.
    from drivecomm.plant import read_plant

    try:
        return read_plant(path), []
    except Exception as error:  # noqa: BLE001 - the readable part is used instead
        from drivecomm.plant import salvaged

        try:
            plant, lost = salvaged(path)
        except Exception:  # noqa: BLE001 - the first error is the useful one
            raise error from None
        return plant, [f"{error}; stopping the drives that can still be read", *lost]
