"""Clients of each door: how they hold a drive, command it and stop it over a real connection.

`give` returns what became of a command as the door answers it; `wrong` names the ways in which a command of this door
can be wrong, with what to change in it. A stop says that it is of another time, where its protocol can say so.
"""

from broker_hands import MqttHand, SparkplugHand
from json_hands import HttpHand, LinesHand
from machine_hands import ModbusTcpHand, OpcuaHand

HANDS = {hand.kind: hand for hand in (HttpHand, LinesHand, ModbusTcpHand, MqttHand, OpcuaHand, SparkplugHand)}
