from .found import Foreign as Foreign, ForeignRegister as ForeignRegister, NotCarried as NotCarried
from .made import drives_of as drives_of, imported_model as imported_model
from .reading import read_foreign as read_foreign
