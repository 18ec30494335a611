from .diagnosis import examine as examine, harmless_bytes as harmless_bytes
from .examination import Examination as Examination
from .findings import Finding as Finding, arrival_grid_s as arrival_grid_s, judge as judge
