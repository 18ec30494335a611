"""The HTTP door: the plant as JSON, event stream, metrics and web page; and the local door, on a unix socket.

Pydantic models validate the requests, and FastAPI builds the OpenAPI description from these models. FastAPI, uvicorn
and prometheus_client are imported only when a door runs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
