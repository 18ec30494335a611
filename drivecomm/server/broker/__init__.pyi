from .broker import Broker as Broker, Messages as Messages
from .connection import (
    BrokerConnection as BrokerConnection,
    BrokerMessage as BrokerMessage,
    IdentityTakenOver as IdentityTakenOver,
    ReceivedMessage as ReceivedMessage,
    VersionRefused as VersionRefused,
    connect_to_broker as connect_to_broker,
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
