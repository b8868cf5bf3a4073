"""The sign of life of a call in its sweep's folder: who computes for it on other machines ends when it does.

A file, not a message: it also shows that both machines see the same folder, and it falls silent with its writer,
however that ended. It is written in place: a network file system shows new content sooner than a new file.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path

from suspend.io.files import storage_errors

NAME = "sweep.lease"
RENEW = 5.0  # seconds between signs of life
EXPIRY = 120.0  # seconds without one after which the call is taken to be gone; network file systems may lag by 60 s
ENDED = "ended"
_DIGITS = 16  # of the counter: no write changes the length, so none fails where the disk is full


class Lease:
    """Held by a call. `token` tells it from any other. Raises StorageError where the folder cannot be written."""

    def __init__(self, folder: Path):
        self.path = folder / NAME
        self.token = os.urandom(8).hex()
        self._count, self._renewed = 0, time.monotonic()
        with storage_errors("write", self.path):
            self.path.unlink(missing_ok=True)
            self._descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644)
            self._write("0" * _DIGITS)

    def renew(self) -> None:
        """Give a sign of life where it is time for one. Raises StorageError."""
        if time.monotonic() - self._renewed > RENEW:
            self._renewed = time.monotonic()
            self._count += 1
            with storage_errors("write", self.path):
                self._write(f"{self._count:0{_DIGITS}d}")

    def end(self) -> None:
        """From now on whoever computes for this call stops, with a checkpoint."""
        with suppress(OSError):  # a lease that is not renewed ends as well
            self._write(ENDED.ljust(_DIGITS))

    def remove(self) -> None:
        """End it and remove the file."""
        self.end()
        with suppress(OSError):
            os.close(self._descriptor)
            self.path.unlink()

    def _write(self, text: str) -> None:
        os.pwrite(self._descriptor, f"{self.token} {text}\n".encode(), 0)
        os.fsync(self._descriptor)


class LeaseWatch:
    """Seen from another process, by its own clock."""

    def __init__(self, folder: Path, token: str, expiry: float = EXPIRY):
        self.path, self.token, self.expiry = folder / NAME, token, expiry
        self._last, self._since = "", time.monotonic()

    def is_visible(self) -> bool:
        """Whether the folder seen here is the one that the call sees."""
        if not self._read().startswith(self.token):
            look_again(self.path.parent)
        return self._read().startswith(self.token)

    def is_held(self) -> bool:
        """Whether the call is alive; True for `expiry` seconds after what was its last sign of life."""
        content = self._read()
        if content and (not content.startswith(self.token) or ENDED in content):
            return False
        now = time.monotonic()
        if content and content != self._last:
            self._last, self._since = content, now
        return now - self._since < self.expiry

    def _read(self) -> str:
        try:
            return self.path.read_text(encoding="ascii")
        except (OSError, ValueError):
            return ""


def look_again(folder: Path) -> None:
    """Make a network file system ask for the folder's entries, of which it may remember that one was not there."""
    with suppress(OSError):
        os.listdir(folder)
