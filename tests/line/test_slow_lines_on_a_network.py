"""The times of a slow line hold also where a network hands a reply on in one piece."""

import threading
from dataclasses import replace

import pytest

from drivecomm.bus import open_bus
from drivecomm.virtual import Server, parse_listen, virtual_drive

READ = {
    "danfoss-fc": ("fc302", "16-13"),
    "fuji": ("frenic", "M09"),
    "uss": ("micromaster4", "1082"),
    "vabus": ("agile", "481"),
}


@pytest.mark.soak
@pytest.mark.parametrize("listen", ["tcp:127.0.0.1:0", "rfc2217:127.0.0.1:0"])
@pytest.mark.parametrize("protocol", READ)
def test_drive_on_1200_baud_answers_within_the_usual_reply_time(protocol, listen):
    model, parameter = READ[protocol]
    virtual = virtual_drive(protocol, 1, model=model)
    virtual.settings = replace(virtual.settings, baudrate=1200)
    stop = threading.Event()
    with Server([virtual], parse_listen(listen), paced=True) as server:
        thread = threading.Thread(target=server.run, args=(stop,))
        thread.start()
        try:
            scheme = listen.partition(":")[0].replace("tcp", "socket")
            with open_bus(f"{scheme}://{server.address.partition('://')[2]}") as bus:
                drive = bus.drive(protocol, 1, model=model, baudrate=1200, attempts=1)
                for _ in range(2):
                    drive.read(parameter)
                assert bus.counters[drive.name]["timeouts"] == 0
        finally:
            stop.set()
            thread.join()
