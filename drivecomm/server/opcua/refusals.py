"""The error for a part of a request that this server refuses."""

from __future__ import annotations

from asyncua import ua


class RefusedPartError(Exception):
    """Refusal of a filter, aggregate or continuation point. code: status code with the reason."""

    def __init__(self, code: int) -> None:
        super().__init__(ua.status_codes.code_to_name_doc[code][0])
        self.code = code
