"""Whether drives on one line can take each other's telegrams for their own."""

from drivecomm.cohabitation.check import (
    Cohabitation as Cohabitation,
)
from drivecomm.cohabitation.check import (
    check_line as check_line,
)
from drivecomm.cohabitation.drives import (
    LineDrive as LineDrive,
)
from drivecomm.cohabitation.verdicts import (
    Outcome as Outcome,
)
from drivecomm.cohabitation.verdicts import (
    Proof as Proof,
)
from drivecomm.cohabitation.verdicts import (
    ProofTelegram as ProofTelegram,
)
from drivecomm.cohabitation.verdicts import (
    Verdict as Verdict,
)
