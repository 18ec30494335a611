from .bench import InterceptedDrive as InterceptedDrive
from .calls import call_blocking as call_blocking
from .checking import Check as Check, CheckFailure as CheckFailure
from .conformance import (
    FULL as FULL,
    QUICK as QUICK,
    all_checks as all_checks,
    checks_of as checks_of,
    conformance_tests as conformance_tests,
    first_failure as first_failure,
    make_report as make_report,
    results as results,
    run_checks as run_checks,
    run_conformance as run_conformance,
    skipped_checks as skipped_checks,
)
from .conversation_strategies import limits as limits
from .exchange_vectors import (
    ExchangeVector as ExchangeVector,
    Expected as Expected,
    VectorCall as VectorCall,
    WireStep as WireStep,
)
from .fixtures import (
    LineMaker as LineMaker,
    MakesDrive as MakesDrive,
    MakesLine as MakesLine,
    MakesPlant as MakesPlant,
    MakesServer as MakesServer,
)
from .html_page import html_page as html_page, made_with as made_with
from .pyserial import clock_of as clock_of, serial_url as serial_url
from .report import (
    CheckResult as CheckResult,
    Reasons as Reasons,
    Report as Report,
    carry_out as carry_out,
    notes_of as notes_of,
    page as page,
    sections_of as sections_of,
    try_out as try_out,
)
from .script import play as play
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
from .watched_line import ServingThread as ServingThread
from .watched_server import WatchedServer as WatchedServer
