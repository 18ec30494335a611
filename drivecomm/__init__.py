"""One interface to variable-frequency drives of different makers over serial lines."""

import lazy_loader

_name_of_face, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Return a public name or a module of drivecomm, and load it at its first use."""
    try:
        return _name_of_face(name)
    except AttributeError:
        from importlib.util import find_spec

        if name.startswith("_") or find_spec(f"{__name__}.{name}") is None:
            raise
    from importlib import import_module

    return import_module(f"{__name__}.{name}")
