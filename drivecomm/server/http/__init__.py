"""The HTTP door: the plant as JSON, as a stream of events, as metrics and as a page; and the local door, on a socket.

FastAPI checks requests by pydantic models, and makes the OpenAPI description from them. It, uvicorn and
prometheus_client are loaded when a door runs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
