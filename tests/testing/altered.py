"""Wrapper that alters protocols and their parts for tests."""


class Altered:
    """Wrapper of any object with some attributes replaced."""

    def __init__(self, real, **attributes):
        self._real = real
        self._attributes = attributes

    def __getattr__(self, name):
        return self._attributes[name] if name in self._attributes else getattr(self._real, name)
