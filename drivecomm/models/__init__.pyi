from .check import check_model as check_model
from .fact_samples import Fact as Fact, facts as facts, sample_facts as sample_facts
from .files import (
    load_model as load_model,
    model_names as model_names,
    model_paths as model_paths,
    open_model_file as open_model_file,
    packaged_models as packaged_models,
    read_model as read_model,
)
from .monitoring import MONITORING_ONLY as MONITORING_ONLY, is_monitoring_only as is_monitoring_only
from .plausible import Plausibility as Plausibility
from .proofs import (
    contradicted as contradicted,
    contradicted_orders as contradicted_orders,
    with_confirmed as with_confirmed,
    without_proofs as without_proofs,
)
from .quantities import (
    TEXT_QUANTITIES as TEXT_QUANTITIES,
    CommonName as CommonName,
    Quantity as Quantity,
    converted as converted,
    factor_between as factor_between,
    parameter_at as parameter_at,
    quantities as quantities,
    unmapped_name_error as unmapped_name_error,
)
from .rules import link_loss_of as link_loss_of
from .schema import PARAMETER_KEYS as PARAMETER_KEYS, TABLES as TABLES, TEXTS as TEXTS
from .setup_sheets import (
    PURPOSES as PURPOSES,
    SheetRow as SheetRow,
    codes_of as codes_of,
    held_codes as held_codes,
    in_words as in_words,
    setup_sheet as setup_sheet,
    uncovered_rates as uncovered_rates,
)
from .sureness import sureness_of_facts as sureness_of_facts
from .writing import model_text as model_text
