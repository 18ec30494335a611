from .contents import measured_content as measured_content
from .findings import Finding as Finding, judge as judge, latency_timer_s as latency_timer_s
from .measurements import Measurements as Measurements
from .measuring import harmless_bytes as harmless_bytes, measure as measure
