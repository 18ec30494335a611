"""Plant files for stopping: of one that is damaged, as much as can be read."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from drivecomm.plant import Plant


def readable_plant(path: Path) -> tuple[Plant, list[str]]:
    """Return the plant of a file as far as it can be read, and what is wrong with the file, in sentences.

    No sentences mean that this is the whole plant. Raises FileFormatError when nothing can be read.
    """
    # Only who has a plant file needs the reader of it.
    from drivecomm.plant import read_plant

    try:
        return read_plant(path), []
    except Exception as error:  # noqa: BLE001 - as far as it can be read
        from drivecomm.plant import salvaged

        try:
            plant, lost = salvaged(path)
        except Exception:  # noqa: BLE001 - what was wrong first is said
            raise error from None
        return plant, [f"{error}; what else can be read of it is stopped", *lost]
