"""The machine under QEMU: booted, spoken to, and cut off from its power."""

import json
import os
import select
import socket
import subprocess
import time
from pathlib import Path
from typing import Any, NamedTuple

from system.receiver import Receiver

DEBIAN = os.environ.get("IMU_TRACKER_SYSTEM_DEBIAN") or (
    Path("/etc/debian_version").read_text("ascii").partition(".")[0]
    if Path("/etc/debian_version").exists()
    else "12"
)
_BUILDS = os.environ.get("IMU_TRACKER_SYSTEM_BUILD") or (
    Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    / "imu-tracker-system"
)
BUILD = Path(f"{_BUILDS}-{DEBIAN}")
"""Where `build_image.sh` puts the kernel and the image."""

ACCELERATOR = os.environ.get("IMU_TRACKER_SYSTEM_ACCEL", "tcg,thread=multi")
"""Emulation works everywhere; `kvm` is ten times as fast where there is one."""

BOOT_S = 900.0  # 9 s on two idle cores; beside a dozen others a minute and more
COMMAND_S = 900.0

_KERNEL_LINE = (
    "console=ttyS0 root=/dev/vda quiet loglevel=3 mitigations=off no_timer_check "
    "tsc=reliable panic=-1 systemd.show_status=0"
)


class Done(NamedTuple):
    """How a command inside the machine ended."""

    code: int
    out: str
    err: str


class Machine:
    """A computer with a disk, a receiver on its second serial port, and no network.

    Parameters
    ----------
    directory : Path
        For its disk, its sockets and its console.
    host : Path
        What it sees, read-only, as /mnt/host.
    receiver : Receiver
        Speaks whenever the machine is on.
    """

    def __init__(self, directory: Path, host: Path, receiver: Receiver) -> None:
        self._directory, self._host, self._receiver = directory, host, receiver
        self._disk = directory / "disk.qcow2"
        self._qemu: subprocess.Popen[bytes] | None = None
        self._agent: socket.socket | None = None
        self._heard = b""
        golden = BUILD / "rootfs.ext4"
        subprocess.run(
            [
                *("qemu-img", "create", "-q", "-f", "qcow2"),
                *("-F", "raw", "-b", golden, self._disk),
            ],
            check=True,
        )

    @property
    def console(self) -> str:
        """What the kernel said."""
        return (self._directory / "console").read_text(errors="replace")

    def boot(self) -> float:
        """Switch it on; return the seconds until it can be spoken to."""
        begun_s = time.monotonic()
        agent, gps = self._directory / "agent.socket", self._directory / "gps.socket"
        for path in (agent, gps):
            path.unlink(missing_ok=True)
        with (self._directory / "console").open("ab") as console:
            self._qemu = subprocess.Popen(
                self._command(agent, gps),
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
            )
        self._agent = self._connect(agent)
        self._heard = b""
        self._receiver.plug_in(self._connect(gps))
        assert self._hear(BOOT_S) == {"ready": True}
        return time.monotonic() - begun_s

    def cut_power(self) -> None:
        """End it between two instructions; what it had not flushed is gone."""
        self._receiver.pull_out()
        if self._agent is not None:
            self._agent.close()
            self._agent = None
        if self._qemu is not None:
            self._qemu.kill()
            self._qemu.wait()
            self._qemu = None

    def tries(self, command: str, timeout_s: float = COMMAND_S) -> Done:
        """Run a command as root; return how it ended."""
        assert self._agent is not None, "the machine is off"
        request = {"command": command, "timeout_s": timeout_s}
        self._agent.sendall(json.dumps(request).encode() + b"\n")
        answer = self._hear(timeout_s + 60)
        return Done(answer["code"], answer["out"], answer["err"])

    def runs(self, command: str, timeout_s: float = COMMAND_S) -> str:
        """Run a command as root, which must go well; return what it printed."""
        done = self.tries(command, timeout_s)
        assert done.code == 0, f"{command}\n{done.out}{done.err}(exit code {done.code})"
        return done.out

    def _command(self, agent: Path, gps: Path) -> list[str | Path]:
        shared = f"local,path={self._host},mount_tag=host,security_model=none"
        return [
            *("qemu-system-x86_64", "-M", "q35", "-accel", ACCELERATOR),
            *("-cpu", "max", "-smp", "2", "-m", "1024"),
            *("-nodefaults", "-no-user-config", "-display", "none"),
            *("-nic", "none", "-no-reboot"),
            *("-kernel", BUILD / "vmlinuz", "-initrd", BUILD / "initrd.img"),
            *("-append", _KERNEL_LINE),
            *("-drive", f"file={self._disk},if=none,id=disk,cache=writeback"),
            *("-device", "virtio-blk-pci,drive=disk", "-device", "virtio-rng-pci"),
            *("-chardev", "stdio,id=console,signal=off"),
            *("-serial", "chardev:console"),
            *("-chardev", f"socket,id=gps,path={gps},server=on,wait=off"),
            *("-serial", "chardev:gps"),
            *("-device", "virtio-serial-pci"),
            *("-chardev", f"socket,id=agent,path={agent},server=on,wait=off"),
            *("-device", "virtserialport,chardev=agent,name=imu-tracker-test"),
            *("-virtfs", f"{shared},readonly=on"),
        ]

    def _connect(self, path: Path) -> socket.socket:
        end_s = time.monotonic() + 60
        while True:
            connection = socket.socket(socket.AF_UNIX)
            try:
                connection.connect(os.fspath(path))
            except OSError:
                connection.close()
                assert self._qemu is not None
                assert self._qemu.poll() is None, f"QEMU ended:\n{self.console}"
                assert time.monotonic() < end_s, f"QEMU does not open {path}"
                time.sleep(0.05)
            else:
                return connection

    def _hear(self, timeout_s: float) -> dict[str, Any]:
        """Return the next line of the agent."""
        assert self._agent is not None
        end_s = time.monotonic() + timeout_s
        while b"\n" not in self._heard:
            wait_s = max(0.0, end_s - time.monotonic())
            is_ready, _, _ = select.select([self._agent], [], [], wait_s)
            assert is_ready, f"no answer in {timeout_s:g} s\n{self.console[-2000:]}"
            chunk = self._agent.recv(65536)
            assert chunk, f"the machine is off\n{self.console[-2000:]}"
            self._heard += chunk
        line, _, self._heard = self._heard.partition(b"\n")
        answer: dict[str, Any] = json.loads(line)
        return answer
