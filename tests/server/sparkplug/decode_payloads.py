"""Decoder of payloads, given as lines of hexadecimal digits, to JSON; needs a Python with pysparkplug."""

import json
import sys

from pysparkplug._protobuf import Payload

for line in filter(None, sys.stdin.read().split("\n")):
    payload = Payload.FromString(bytes.fromhex(line))
    metrics = []
    for metric in payload.metrics:
        which = metric.WhichOneof("value")
        said = dict(zip(metric.properties.keys, metric.properties.values, strict=True))
        metrics.append(
            {
                "name": metric.name,
                "alias": metric.alias if metric.HasField("alias") else None,
                "timestamp": metric.timestamp,
                "datatype": metric.datatype,
                "null": metric.is_null,
                "historical": metric.is_historical,
                "value": None if which is None else getattr(metric, which),
                "quality": said["Quality"].int_value if "Quality" in said else None,
            }
        )
    seq = payload.seq if payload.HasField("seq") else None
    sys.stdout.write(json.dumps({"timestamp": payload.timestamp, "seq": seq, "metrics": metrics}) + "\n")
