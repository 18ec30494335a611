from .broker import Broker as Broker, Messages as Messages
from .connection import (
    Connection as Connection,
    IdentityTakenOver as IdentityTakenOver,
    Message as Message,
    Received as Received,
    VersionRefused as VersionRefused,
    connected as connected,
    refusal as refusal,
    tls_context as tls_context,
)
from .identity import client_id_of as client_id_of
from .settings import (
    BROKER_KEYS as BROKER_KEYS,
    BrokerSettings as BrokerSettings,
    broker_settings as broker_settings,
    first_line as first_line,
)
