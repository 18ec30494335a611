from .contents import measured_content as measured_content
from .findings import DoctorFinding as DoctorFinding, judge as judge, latency_timer_s as latency_timer_s
from .listening import IdleObservation as IdleObservation, harmless_bytes as harmless_bytes, listen as listen
from .measurements import Measurements as Measurements
from .measuring import ask as ask, measure as measure
