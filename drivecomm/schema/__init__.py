"""The vocabulary in which protocols declare their telegrams."""

from drivecomm.schema.by_name import message_of as message_of
from drivecomm.schema.form import Form as Form
from drivecomm.schema.leaves import (
    Check as Check,
)
from drivecomm.schema.leaves import (
    Leaf as Leaf,
)
from drivecomm.schema.leaves import (
    characters as characters,
)
from drivecomm.schema.leaves import (
    choice as choice,
)
from drivecomm.schema.leaves import (
    constant as constant,
)
from drivecomm.schema.leaves import (
    decimal_number as decimal_number,
)
from drivecomm.schema.leaves import (
    decimal_sum as decimal_sum,
)
from drivecomm.schema.leaves import (
    filler as filler,
)
from drivecomm.schema.leaves import (
    hex_number as hex_number,
)
from drivecomm.schema.leaves import (
    hex_sum as hex_sum,
)
from drivecomm.schema.leaves import (
    hex_value as hex_value,
)
from drivecomm.schema.leaves import (
    shifted_character as shifted_character,
)
from drivecomm.schema.leaves import (
    signed as signed,
)
from drivecomm.schema.leaves import (
    unsigned as unsigned,
)
from drivecomm.schema.leaves import (
    xor_byte as xor_byte,
)
from drivecomm.schema.written import Written as Written
