"""What a part of a request ends with that this server does not carry out."""

from __future__ import annotations

from asyncua import ua


class RefusedPartError(Exception):
    """A filter, an aggregate or a continuation point that is refused. code: the status code that says why."""

    def __init__(self, code: int) -> None:
        super().__init__(ua.status_codes.code_to_name_doc[code][0])
        self.code = code
