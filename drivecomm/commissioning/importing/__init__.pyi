from .foreign_contents import (
    ForeignContents as ForeignContents,
    ForeignRegister as ForeignRegister,
    OmittedItem as OmittedItem,
)
from .made import drives_of as drives_of, imported_model as imported_model
from .reading import read_foreign as read_foreign
