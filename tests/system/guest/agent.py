#!/usr/bin/python3
"""Runs the commands of the tests, inside the machine, as root.

One JSON object a line, over a virtio port: {"command": ..., "timeout_s": ...} comes,
{"code": ..., "out": ..., "err": ...} goes back.
"""

import json
import os
import subprocess
import time

PORT = "/dev/virtio-ports/imu-tracker-test"


def run(command: str, timeout_s: float) -> dict[str, object]:
    try:
        done = subprocess.run(
            ["/bin/bash", "-c", command],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return {"code": 124, "out": "", "err": f"not done after {timeout_s:g} s"}
    out, err = (text.decode(errors="replace") for text in (done.stdout, done.stderr))
    return {"code": done.returncode, "out": out, "err": err}


def send(port: int, answer: dict[str, object]) -> None:
    data = json.dumps(answer).encode() + b"\n"
    while data:
        data = data[os.write(port, data) :]


def main() -> None:
    port = os.open(PORT, os.O_RDWR)
    send(port, {"ready": True})
    pending = b""
    while True:
        chunk = os.read(port, 65536)
        if not chunk:  # nobody on the other side
            time.sleep(0.1)
        *lines, pending = (pending + chunk).split(b"\n")
        for line in lines:
            request = json.loads(line)
            send(port, run(request["command"], request["timeout_s"]))


if __name__ == "__main__":
    main()
