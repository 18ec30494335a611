"""Monitoring of a line on which others talk: the telegrams, their senders, and the replies with their times."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
