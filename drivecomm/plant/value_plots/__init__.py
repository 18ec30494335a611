"""Plots of value logs: PNG, SVG, and self-contained HTML pages."""

import lazy_loader

from drivecomm.former_names import with_former_names

_FORMER_NAMES = {
    "Picture": "PlotContents",
}
_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_former_names(__name__, _find, _FORMER_NAMES)
