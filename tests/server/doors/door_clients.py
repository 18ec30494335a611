"""Clients of each door: how they hold a drive, command it and stop it over a real connection.

`give` returns the outcome of a command as the door reports it. `wrong` names the ways in which a command of this door
can be invalid, with the arguments that make it so. `stop` marks a stop as stale, if its protocol has a field for it;
doors must send it all the same.
"""

from broker_door_clients import MqttHand, SparkplugHand
from json_door_clients import HttpHand, LinesHand
from machine_door_clients import ModbusTcpHand, OpcuaHand

HANDS = {hand.kind: hand for hand in (HttpHand, LinesHand, ModbusTcpHand, MqttHand, OpcuaHand, SparkplugHand)}
