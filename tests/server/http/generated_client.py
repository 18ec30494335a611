"""Commands to a drive by `hall`, a client that openapi-python-client generated from the server's description."""

import json
import sys

from hall import AuthenticatedClient, Client
from hall.api.default import command, drive, keep, login, take_lease
from hall.models import CarryOut, CarryOutArguments, CommandVerb, Credentials, Keep, TakeLease

SERVER = sys.argv[1]


def token(name):
    answer = login.sync(client=Client(SERVER), body=Credentials(name=name, password=f"{name}'s password"))
    return AuthenticatedClient(SERVER, answer.token)


def commanded(name, verb, **arguments):
    body = CarryOut(id=f"{name} {verb}", arguments=CarryOutArguments.from_dict(arguments))
    return command.sync(name="saw", verb=CommandVerb(verb), client=token(name), body=body)


refused = commanded("anna", "start")
otto = token("otto")
reference = commanded("otto", "set_reference", percent=10)
lease = take_lease.sync(name="saw", client=otto, body=TakeLease(seconds=10))
kept = keep.sync(name="saw", client=otto, body=Keep(id="otto keep", lease=lease.key, percent=20))
sys.stdout.write(
    json.dumps(
        {
            "refused": [refused.status, refused.outcome, refused.error.kind],
            "done": [reference.outcome, kept.outcome],
            "armed": drive.sync(name="saw", client=token("anna")).armed,
        }
    )
)
