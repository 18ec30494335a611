from .answers import Answer as Answer
from .course import (
    Course as Course,
    chosen_course as chosen_course,
    course as course,
    without_elements as without_elements,
)
from .exploring import (
    Asks as Asks,
    Progress as Progress,
    Step as Step,
    exploring as exploring,
    is_there as is_there,
    unseen as unseen,
)
from .faces import explore as explore, explore_async as explore_async
from .forecast import Forecast as Forecast, forecasting as forecasting
from .identity import identity_told as identity_told, lasting as lasting
from .logbook import Forgetful as Forgetful, Logbook as Logbook, Remembers as Remembers, logbook_path as logbook_path
