"""The MPU-6050 of `fake_i2c` behind a real `/dev/i2c-N`, inside the machine.

It plays an "i2c-tiny-usb" adapter that is plugged into the kernel's virtual USB host
controller, the one of USB/IP: the stock driver makes an I2C adapter of it, and every
transfer comes here. So the whole way from the daemon through i2c-dev to the wires is
the kernel's own, and the wires can fail:

    nack on|off|once  nobody acknowledges
    stall on|off      the adapter refuses each transfer
    hang on|off       the adapter answers nothing; the kernel gives up after 2 s
    unplug, plug      the adapter is taken out, and put back
    brownout          the chip loses its power for an instant
    report            only tell

One such line over the socket `CONTROL` gives one JSON object back: the instant at
which it was done, when the chip was last woken up, the transfers so far, and what was
asked of the chip against its datasheet.

Sources: Documentation/usb/usbip_protocol.rst and drivers/i2c/busses/i2c-tiny-usb.c of
the Linux kernel.
"""

import errno
import json
import os
import socket
import struct
import threading
import time
from contextlib import suppress
from pathlib import Path
from random import Random

from fake_i2c import DatasheetError, FakeMpu6050
from fake_i2c.world import Feeling

CONTROL = "/run/imu-tracker-test-bus"
ADDRESS = 0x68

# The train of receiver.py goes at constant speed, and shakes as trains do.
VIBRATION_G = 0.015
VIBRATION_DPS = 0.3

_VHCI = Path("/sys/devices/platform/vhci_hcd.0")
_DEVICE_ID = 65538
_FULL_SPEED = 2

# USB/IP: commands and their answers.
_SUBMIT, _UNLINK, _SUBMITTED, _UNLINKED = 1, 2, 3, 4
_HEADER_BYTES = 48

# i2c-tiny-usb: requests of the vendor, and the states of the last transfer.
_ECHO, _GET_FUNC, _SET_DELAY, _GET_STATUS, _IO = 0, 1, 2, 3, 4
_ACKNOWLEDGED, _NOT_ACKNOWLEDGED = 1, 2
_FUNCTIONS = 0x0EFF0009  # plain I2C, and SMBus as the kernel makes it of that

_DEVICE = bytes((18, 1, 0x10, 0x01, 0xFF, 0, 0, 8)) + struct.pack(
    "<HHH4B", 0x0403, 0xC631, 0x0205, 1, 2, 0, 1
)
_CONFIGURATION = bytes((9, 2, 18, 0, 1, 1, 0, 0x80, 50, 9, 4, 0, 0, 0, 0xFF, 0, 0, 0))
_NAMES = ("imu-tracker", "i2c-tiny-usb")


class Clock:
    """The time that the chip lives in."""

    def now_ns(self) -> int:
        return time.monotonic_ns()


class Ride:
    """What the chip feels on the way."""

    def __init__(self) -> None:
        self._random = Random(1200)

    def __call__(self, _: float) -> Feeling:
        ax, ay, az = (self._random.gauss(0.0, VIBRATION_G) for _ in range(3))
        gx, gy, gz = (self._random.gauss(0.0, VIBRATION_DPS) for _ in range(3))
        return Feeling((ax, ay, 1.0 + az), (gx, gy, gz))


class Adapter:
    """The USB device: what it answers to each control transfer."""

    def __init__(self, chip: FakeMpu6050) -> None:
        self.chip = chip
        self.faults: set[str] = set()
        self.transfers = 0
        self.violations: list[str] = []
        self.woke_s = 0.0  # when the chip was last woken up
        self._register = 0
        self._status = 0

    def control(self, setup: bytes, data: bytes) -> tuple[int, bytes]:
        """Return a negative errno or 0, and what is read."""
        kind, request, value, index, length = struct.unpack("<BBHHH", setup)
        is_read = bool(kind & 0x80)
        if not kind & 0x60:  # a request of the standard
            return self._standard(is_read, request, value, length)
        if request & _IO:
            return self._transfer(index, length if is_read else None, data)
        answer = {
            _ECHO: struct.pack("<H", value),
            _GET_FUNC: struct.pack("<I", _FUNCTIONS),
            _SET_DELAY: b"",
            _GET_STATUS: bytes((self._status,)),
        }[request]
        return 0, answer[:length]

    def _standard(
        self, is_read: bool, request: int, value: int, length: int
    ) -> tuple[int, bytes]:
        if not is_read:  # SET_CONFIGURATION and the like: granted
            return 0, b""
        if request != 6:  # GET_STATUS
            return 0, bytes(2)
        kind, number = value >> 8, value & 255
        strings = [b"\x04\x03\x09\x04"]  # in English
        for name in _NAMES:
            text = name.encode("utf-16le")
            strings.append(bytes((2 + len(text), 3)) + text)
        try:
            found = {1: [_DEVICE], 2: [_CONFIGURATION], 3: strings}[kind][number]
        except (KeyError, IndexError):
            return -errno.EPIPE, b""
        return 0, found[:length]

    def _transfer(
        self, address: int, length: int | None, data: bytes
    ) -> tuple[int, bytes]:
        """Do one message: a read of `length` bytes, or a write of `data`."""
        self.transfers += 1
        if "stall" in self.faults:
            return -errno.EPIPE, b""
        if self.faults & {"nack", "nack once"} or address != ADDRESS:
            self.faults.discard("nack once")
            self._status = _NOT_ACKNOWLEDGED
            return 0, bytes(length or 0)
        self._status = _ACKNOWLEDGED
        try:
            if length is not None:
                return 0, self.chip.read(self._register, length)
            if data:
                self._register = data[0]
            was_asleep = self.chip.is_asleep
            for offset, byte in enumerate(data[1:]):
                self.chip.write(self._register + offset, byte)
            if was_asleep and not self.chip.is_asleep:
                self.woke_s = time.monotonic()
        except DatasheetError as error:
            self.violations.append(str(error))
            return -errno.EPIPE, b""
        return 0, b""


class Cable:
    """Plugs the adapter into the kernel, and carries what the two say."""

    def __init__(self, adapter: Adapter) -> None:
        self._adapter = adapter
        self._lock = threading.Lock()
        self._is_in = threading.Event()
        self._is_in.set()

    def tell(self, line: str) -> dict[str, object]:
        """Do what one line of the control socket says."""
        match line.split():
            case [("nack" | "stall" | "hang") as fault, "on"]:
                self._adapter.faults.add(fault)
            case [("nack" | "stall" | "hang") as fault, "off"]:
                self._adapter.faults.discard(fault)
            case ["nack", "once"]:
                self._adapter.faults.add("nack once")
            case ["unplug"]:
                self._is_in.clear()
                (_VHCI / "detach").write_text("0")
            case ["plug"]:
                self._is_in.set()
            case ["brownout"]:
                with self._lock:
                    self._adapter.chip.brown_out()
            case ["report"]:
                pass
            case _:
                return {"error": f"unknown: {line}"}
        return {
            "t_s": time.monotonic(),
            "woke_s": self._adapter.woke_s,
            "transfers": self._adapter.transfers,
            "violations": self._adapter.violations,
        }

    def serve(self) -> None:
        """Be plugged in, whenever the control says so, for ever."""
        while self._is_in.wait():
            ours, kernels = socket.socketpair()
            with ours:
                with kernels:
                    words = (0, kernels.fileno(), _DEVICE_ID, _FULL_SPEED)
                    (_VHCI / "attach").write_text(" ".join(map(str, words)))
                with suppress(EOFError, OSError):
                    while True:
                        self._answer(ours)
            while self._is_in.is_set():  # until the control says that it is out
                time.sleep(0.05)

    def _answer(self, wire: socket.socket) -> None:
        header = _read(wire, _HEADER_BYTES)
        command, number, _, is_in, _ = struct.unpack(">5I", header[:20])
        (length,) = struct.unpack(">i", header[24:28])
        if command == _UNLINK:  # of a transfer that hangs: the others are answered
            answer = struct.pack(
                ">5Ii24x", _UNLINKED, number, 0, 0, 0, -errno.ECONNRESET
            )
            wire.sendall(answer)
            return
        data = b"" if is_in else _read(wire, length)
        if "hang" in self._adapter.faults:
            return
        with self._lock:
            status, back = self._adapter.control(header[40:48], data)
        n_bytes = len(back) if is_in else len(data)
        wire.sendall(
            struct.pack(
                ">5IiiIII8x", _SUBMITTED, number, 0, 0, 0, status, n_bytes, 0, 0, 0
            )
            + (back if is_in else b"")
        )


def _read(wire: socket.socket, length: int) -> bytes:
    data = b""
    while len(data) < length:
        chunk = wire.recv(length - len(data))
        if not chunk:
            raise EOFError
        data += chunk
    return data


def _listen(cable: Cable) -> None:
    with suppress(FileNotFoundError):
        Path(CONTROL).unlink()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(CONTROL)
        server.listen()
        while True:
            with server.accept()[0] as caller:
                line = caller.recv(4096).decode().strip()
                caller.sendall(json.dumps(cable.tell(line)).encode())


def main() -> None:
    # Hardware waits for nobody.
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    chip = FakeMpu6050(Clock(), clock_error=0.01)
    chip.world.follow(Ride())
    cable = Cable(Adapter(chip))
    threading.Thread(target=_listen, args=(cable,), daemon=True).start()
    cable.serve()


if __name__ == "__main__":
    main()
