from .baselines import (
    approved_set as approved_set,
    baseline_path as baseline_path,
    read_baseline as read_baseline,
    write_baseline as write_baseline,
)
from .drift import Drift as Drift, drift_between as drift_between, read_drift as read_drift
