"""Conformance kit for protocol packages: vectors, exchanges, checks, fixtures and strategies."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Call": "VectorCall",
    "left_out": "skipped_checks",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
