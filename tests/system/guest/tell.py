"""Tell the bus inside the machine something, see bus.py: `tell.py nack on`."""

import socket
import sys

with socket.socket(socket.AF_UNIX) as control:
    control.connect("/run/imu-tracker-test-bus")
    control.sendall(" ".join(sys.argv[1:]).encode())
    print(control.recv(65536).decode())
