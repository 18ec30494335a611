from .checks import EXCHANGE_CHECKS as EXCHANGE_CHECKS, checks_of as checks_of, run_checks as run_checks
from .entry import Entry as Entry
from .exchange_vectors import Call as Call, ExchangeVector as ExchangeVector, Expected as Expected, Step as Step
from .extent import FULL as FULL, QUICK as QUICK
from .faces import call_blocking as call_blocking
from .fixtures import LineMaker as LineMaker, MakesDrive as MakesDrive, MakesLine as MakesLine, MakesPlant as MakesPlant
from .forms import NamedForm as NamedForm
from .judging import (
    all_checks as all_checks,
    first_failure as first_failure,
    judge as judge,
    left_out as left_out,
    verdicts as verdicts,
)
from .limits import limits as limits
from .property_checks import (
    PROPERTIES as PROPERTIES,
    drawn as drawn,
    measures_rising as measures_rising,
    try_examples as try_examples,
)
from .pytest_items import conformance_tests as conformance_tests
from .report import (
    Check as Check,
    CheckFailure as CheckFailure,
    Report as Report,
    Verdict as Verdict,
    carry_out as carry_out,
    try_out as try_out,
)
from .report_page import page as page
from .report_sections import sections_of as sections_of
from .schema_checks import compiles_whole as compiles_whole, same_both_ways as same_both_ways
from .script_runner import play as play
from .strategies import (
    conversations as conversations,
    fault_plans as fault_plans,
    junk_fields as junk_fields,
    near_telegrams as near_telegrams,
    pieces as pieces,
    telegrams as telegrams,
)
from .vectors import (
    CATEGORIES as CATEGORIES,
    FORMAT as FORMAT,
    Refuse as Refuse,
    Stream as Stream,
    Vector as Vector,
    VectorFile as VectorFile,
    load_vectors as load_vectors,
    packaged_vectors as packaged_vectors,
)
