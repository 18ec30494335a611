"""Listening to a line on which others talk: what was said, who said it, what it answers and how long that took."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
