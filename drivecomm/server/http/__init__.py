"""The HTTP door: the plant as JSON, as a stream of events, as metrics and as a page; and the local door, on a socket.

One table says which routes there are, who may use them and what they take: requests are checked by it, and the OpenAPI
description is made from it. What needs starlette, uvicorn or prometheus_client is loaded when a door runs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
