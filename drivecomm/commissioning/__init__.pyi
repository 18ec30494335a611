from .growing import (
    Described as Described,
    addresses_in as addresses_in,
    descriptions as descriptions,
    grown_model as grown_model,
    growth_plan as growth_plan,
    growth_request as growth_request,
    parameters_of as parameters_of,
    unread_parameters as unread_parameters,
)
from .record import CommissioningRecord as CommissioningRecord, take_record as take_record
from .replacing import (
    Replacement as Replacement,
    check_replacement as check_replacement,
    compare_identities as compare_identities,
)
from .scan_forecast import ScanForecast as ScanForecast, forecast_scan as forecast_scan
from .tuning import (
    EXCHANGES as EXCHANGES,
    TuningResult as TuningResult,
    TuningTrial as TuningTrial,
    tune as tune,
    tune_async as tune_async,
)
