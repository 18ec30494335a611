from .answers import AddressAnswer as AddressAnswer
from .call_styles import explore as explore, explore_async as explore_async
from .exploration_plan import (
    ExplorationPlan as ExplorationPlan,
    chosen_course as chosen_course,
    course as course,
    without_elements as without_elements,
)
from .exploring import (
    Asks as Asks,
    ExplorationStep as ExplorationStep,
    Progress as Progress,
    exploring as exploring,
    is_there as is_there,
    unseen as unseen,
)
from .forecast import ExplorationForecast as ExplorationForecast, forecasting as forecasting
from .identity import lasting_identity as lasting_identity, read_identity as read_identity
from .logbook import (
    AnswerRecord as AnswerRecord,
    Logbook as Logbook,
    NoAnswerRecord as NoAnswerRecord,
    logbook_path as logbook_path,
)
