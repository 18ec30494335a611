from .growing import (
    Described as Described,
    addresses_in as addresses_in,
    asking as asking,
    descriptions as descriptions,
    grown as grown,
    parameters_of as parameters_of,
    unasked as unasked,
    way_to_grow as way_to_grow,
)
from .record import CommissioningRecord as CommissioningRecord, take_record as take_record
from .replacing import (
    Replacement as Replacement,
    check_replacement as check_replacement,
    compare_identities as compare_identities,
)
from .scan_forecast import ScanForecast as ScanForecast, forecast_scan as forecast_scan
from .tuning import EXCHANGES as EXCHANGES, Trial as Trial, Tuned as Tuned, tune as tune, tune_async as tune_async
