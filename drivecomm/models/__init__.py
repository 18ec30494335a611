"""Drive models as data: their files and the rules for these, common quantities, units."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "not_said": "unmapped_name_error",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
