"""Which parameters a VABus drive may hold: numbers 0 to 1599, some of them in data sets 1 to 4.

Numbers of three digits, and A00 to F99 beyond 999: Agile VABus manual p. 30. A parameter whose four data sets differ is
refused in data set 0 with error 9, and answers with data sets 0 to 4 only: Agile manual p. 43, Agile VABus manual p.
30.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivecomm.protocol import AddressSpace, Elements
from drivecomm_vabus.errorcodes import DATASET_NOT_PERMITTED, DATASETS_DIFFER, UNKNOWN_PARAMETER
from drivecomm_vabus.telegrams import PARAMETERS

if TYPE_CHECKING:
    from drivecomm.protocol import Model
    from drivecomm_vabus.options import VabusOptions


def address_space(_options: VabusOptions, _model: Model | None) -> AddressSpace:
    """Return what addresses a drive can hold; no option and no model narrows them."""
    return AddressSpace(
        addresses=lambda: map(str, PARAMETERS),
        absent=frozenset({UNKNOWN_PARAMETER, DATASET_NOT_PERMITTED}),
        source="0 to 999 and A00 to F99: Agile VABus manual p. 30; data sets: Agile manual p. 43",
        elements=_data_sets,
        together={"datasets": 4},
    )


def _data_sets(address: str, code: int | None) -> Elements:
    if code != DATASETS_DIFFER:
        return Elements()
    return Elements(runs=(tuple(f"{address}[{dataset}]" for dataset in range(1, 5)),))
