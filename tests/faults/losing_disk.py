"""A disk that loses in a power cut what was not forced to it, and a process that dies.

A file keeps what it was when it was synced last, and perhaps some of what came later;
a directory its names of when it was synced last, or those of now. Written for the
worst that POSIX allows and ext4 or a card may do, zeros in place of data included.
"""

import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest

_CALLS = ("open", "write", "fsync", "ftruncate", "rename", "replace", "unlink", "mkdir")


class LosingDisk:
    """What of a directory has reached the disk; kept outside of it.

    Parameters
    ----------
    life : Path
        What the process sees: everything that it wrote.
    kept : Path
        What is on the disk: inodes by number, and names by directory.
    """

    def __init__(self, life: Path, kept: Path) -> None:
        self.life = life
        self._inodes, self._names = kept / "inodes", kept / "names"
        self._graves = kept / "graves"  # so that no number of an inode comes twice
        for directory in (life, self._inodes, self._names, self._graves):
            directory.mkdir(parents=True, exist_ok=True)
        self._real = {name: getattr(os, name) for name in _CALLS}
        self.calls = 0

    # ------------------------------------------------------------- in the process

    def mount(self, patch: pytest.MonkeyPatch, die_at: int, rng: Random) -> None:
        """Follow what the process does, and kill it at a call of the `os`."""

        def follow(name: str) -> Callable[..., Any]:
            real, after = self._real[name], getattr(self, f"_after_{name}", None)

            def call(*args: Any, **named: Any) -> Any:
                if not self._is_ours(name, args):
                    return real(*args, **named)
                self.calls += 1
                is_last = self.calls == die_at
                if is_last and name == "write":
                    real(args[0], args[1][: rng.randrange(len(args[1]) + 1)])
                if is_last and (name == "write" or rng.random() < 0.5):
                    os.kill(os.getpid(), signal.SIGKILL)
                if name in ("rename", "replace", "unlink"):
                    self._bury(Path(args[-1]))
                # Only the model is synced: the disk below it has not to.
                found = None if name == "fsync" else real(*args, **named)
                if after is not None:
                    after(*args)
                if is_last:
                    os.kill(os.getpid(), signal.SIGKILL)
                return found

            return call

        for name in _CALLS:
            patch.setattr(os, name, follow(name))

    def _is_ours(self, name: str, args: tuple[Any, ...]) -> bool:
        if name in ("write", "fsync", "ftruncate"):
            path = Path(f"/proc/self/fd/{args[0]}").readlink()
        else:
            path = Path(args[0])
        return path.is_relative_to(self.life)

    def _bury(self, path: Path) -> None:
        if path.is_file():
            grave = self._graves / str(path.stat().st_ino)
            if not grave.exists():
                os.link(path, grave)

    def _after_fsync(self, fd: int) -> None:
        path, found = Path(f"/proc/self/fd/{fd}").readlink(), os.fstat(fd)
        if path.is_dir():
            names = _names_in(path)
            self._keep(self._listing(path), json.dumps(names).encode())
        else:
            data = Path(f"/proc/self/fd/{fd}").read_bytes()
            self._keep(self._inodes / str(found.st_ino), data)

    def _listing(self, directory: Path) -> Path:
        name = str(directory.relative_to(self.life)).replace("/", "+")
        return self._names / f"of {name}"

    def _keep(self, path: Path, data: bytes) -> None:
        new = path.with_name(f"{path.name}.new")
        new.write_bytes(data)
        self._real["replace"](new, path)

    # -------------------------------------------------------------- after the cut

    def cut_the_power(self, rng: Random) -> None:
        """Leave in the directory what a next start finds; forget what was lost."""
        found: dict[Path, bytes] = {}
        for directory in [self.life, *(p for p in self.life.rglob("*") if p.is_dir())]:
            relative = directory.relative_to(self.life)
            names, kept = _names_in(directory), self._listing(directory)
            if rng.random() < 0.5:
                names = json.loads(kept.read_text()) if kept.exists() else {}
            for name, inode in names.items():
                found[relative / name] = self._survivor(inode, rng)
        shutil.rmtree(self.life)
        for store in (self._inodes, self._names, self._graves):
            shutil.rmtree(store)
            store.mkdir()
        for path, data in found.items():
            target = self.life / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
            self._keep(self._inodes / str(target.stat().st_ino), data)
        for directory in {path.parent for path in found}:
            listed = json.dumps(_names_in(self.life / directory)).encode()
            self._keep(self._listing(self.life / directory), listed)

    def _survivor(self, inode: int, rng: Random) -> bytes:
        """Return what is left of a file: at least what was synced, if it ever was."""
        synced = self._inodes / str(inode)
        kept = synced.read_bytes() if synced.exists() else b""
        now = self._now(inode)
        if now is None or not now.startswith(kept):
            return kept
        more = now[len(kept) :]
        more = more[: rng.choice([0, len(more), rng.randrange(len(more) + 1)])]
        zeros = rng.randrange(len(more) + 1) if rng.random() < 0.3 else 0
        return kept + more[: len(more) - zeros] + b"\0" * zeros

    def _now(self, inode: int) -> bytes | None:
        for path in [*self.life.rglob("*"), *self._graves.iterdir()]:
            if path.is_file() and path.stat().st_ino == inode:
                return path.read_bytes()
        return None


def _names_in(directory: Path) -> dict[str, int]:
    return {p.name: p.stat().st_ino for p in directory.iterdir() if p.is_file()}
