from .contents import measured_content as measured_content
from .findings import Finding as Finding, judge as judge, latency_timer_s as latency_timer_s
from .listening import Heard as Heard, harmless_bytes as harmless_bytes, listen as listen
from .measurements import Measurements as Measurements
from .measuring import ask as ask, measure as measure
