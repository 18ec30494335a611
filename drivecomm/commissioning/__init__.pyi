from .growing import Described as Described, addresses_in as addresses_in, descriptions as descriptions, grown as grown
from .scan_forecast import ScanForecast as ScanForecast, forecast_scan as forecast_scan
from .tuning import EXCHANGES as EXCHANGES, Trial as Trial, Tuned as Tuned, tune as tune, tune_async as tune_async
