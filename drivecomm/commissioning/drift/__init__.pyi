from .baselines import (
    approved_set as approved_set,
    baseline_path as baseline_path,
    read_baseline as read_baseline,
    restore_command as restore_command,
    write_baseline as write_baseline,
)
from .drift import (
    Drift as Drift,
    drift_between as drift_between,
    live_addresses as live_addresses,
    read_drift as read_drift,
)
