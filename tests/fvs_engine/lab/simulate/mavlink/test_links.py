"""Links of the simulated vehicle."""

import socket
import struct
import time
from contextlib import closing

import pytest

from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.links import Links

pytestmark = pytest.mark.process

RESET = struct.pack("ii", 1, 0)
"""``SO_LINGER``: closing resets the connection."""


def test_a_station_that_goes_while_messages_of_another_are_handled_ends_nothing() -> None:
    with closing(Links(["tcpin:127.0.0.1:0"])) as links:
        _, host, port = links.urls[0].split(":")
        with socket.create_connection((host, int(port))) as stays:
            list(links.receive(5.0))
            goes = socket.create_connection((host, int(port)))
            list(links.receive(5.0))
            goes.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
            goes.close()
            stays.sendall(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None)))
            time.sleep(0.1)
            received = links.receive(5.0)
            next(received)  # and the other is ready, too
            links.send(b"to all")
            links.send(b"to all")
            assert list(received) == []
