"""Atomic replacement of files, the lock of a run directory, and operating-system errors in plain words."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import socket
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from suspend.errors import StorageError

TEMPORARY = ".tmp"
STALE = 3600.0  # seconds after which a temporary file of whatever name belongs to nobody
_MOST_LINKS = 40  # as the kernel follows
_PIECE = 1 << 20  # bytes copied at a time
_REASONS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file would exceed the file size limit of this process or file system",
    errno.EROFS: "the file system is read-only",
    errno.EACCES: "permission denied",
    errno.EPERM: "the operation is not permitted",
    errno.ENOENT: "the file or its folder does not exist (any more)",
    errno.EEXIST: "a file of that name is in the way",
    errno.ENOTDIR: "a part of the path is a file, not a folder",
    errno.EISDIR: "it is a folder, not a file",
    errno.EIO: "the device reports an input/output error",
    errno.ESTALE: "the network file system lost the file",
    errno.EPIPE: "its reader went away",
    errno.ELOOP: "its symbolic links run in a circle",
    errno.ENXIO: "no one listens there",
}
_TROUBLE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO, errno.ESTALE)
_REMEDIES = {
    errno.ENOSPC: "free some space",
    errno.EDQUOT: "free some space or raise the quota",
    errno.EFBIG: "raise the limit (ulimit -f)",
}


@contextmanager
def storage_errors(action: str, path: os.PathLike | str, advice: str = "") -> Iterator[None]:
    """Turn operating-system and HDF5 errors inside the block into StorageError: "cannot ACTION PATH: reason".

    h5py reports failed writes as OSError or RuntimeError, often with the errno in its text only.
    """
    try:
        yield
    except UnicodeEncodeError as error:  # of the path: some formats take names in UTF-8 only
        raise StorageError(f"cannot {action} {path}: its name is not valid UTF-8; rename it") from error
    except (OSError, RuntimeError) as error:
        code = _errno_of(error)
        reason = _REASONS.get(code) or str(error).strip().splitlines()[0]
        remedy = advice or _REMEDIES.get(code, "")
        raise StorageError(f"cannot {action} {path}: {reason}" + (f"; {remedy}" if remedy else "")) from error


def is_disk_trouble(error: BaseException) -> bool:
    """Whether a StorageError was the device's fault (full, read-only, failing), not that of what is stored there."""
    cause = error.__cause__ if isinstance(error, StorageError) else error
    return cause is not None and _errno_of(cause) in _TROUBLE


def _errno_of(error: BaseException) -> int | None:
    code = getattr(error, "errno", None)
    if code is None:
        found = re.search(r"errno = (\d+)", str(error))
        code = int(found.group(1)) if found else None
    return code


def temporary_name(path: Path) -> Path:
    """A new name for the temporary file that will replace `path` (same folder, so that the rename is atomic).

    No two are equal: beside the writer of a run others may write into its folder, such as two calls of one sweep.
    """
    return path.with_name(f"{path.name}.{os.getpid()}-{os.urandom(4).hex()}{TEMPORARY}")


def replace_atomically(path: Path, fill: Callable[[Path], None], *, sync: bool) -> None:
    """Let `fill` write a temporary file, then rename it to `path`; on any error the temporary is removed.

    A kill at any instant leaves the old file or the new one. With `sync` the same holds for a power cut. A symbolic
    link stays and its target is replaced; what is not a regular file (a device, a FIFO, /dev/stdout) stays too and
    receives the bytes. Raises what `fill` raises, and OSError.
    """
    descriptor = _own_descriptor(path)
    if descriptor is not None or _is_special(path):
        _write_through(path, descriptor, fill)
        return
    path = _target_of(path)
    temporary = temporary_name(path)
    try:
        fill(temporary)
        if sync:
            sync_path(temporary)
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
    if sync:
        sync_path(path.parent)


def _is_special(path: Path) -> bool:
    """True for devices, FIFOs and sockets, also behind links; a folder is left to the error of the rename."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _target_of(path: Path) -> Path:
    """What a symbolic link stands for (it need not exist yet), other paths as they are. Raises OSError (a loop)."""
    if not path.is_symlink():
        return path
    target = Path(os.path.realpath(path))
    if target.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    return target


def _own_descriptor(path: Path) -> int | None:
    """Number of the open file of this process that `path` names (/dev/stdout, /dev/fd/3), or None.

    Opening such a name again would cut the file behind it or write over what was printed.
    """
    own = (f"/proc/{os.getpid()}/fd", f"/proc/{os.getpid()}/task/{threading.get_native_id()}/fd")
    for _ in range(_MOST_LINKS):
        parent = os.path.realpath(path.parent)
        if parent in own and path.name.isdecimal():
            return int(path.name)
        if not path.is_symlink():
            return None
        path = Path(parent) / os.readlink(path)
    return None


def _write_through(path: Path, descriptor: int | None, fill: Callable[[Path], None]) -> None:
    """Fill a file in the folder for temporary files (formats seek in it), then copy it to `path`."""
    with tempfile.TemporaryDirectory(prefix="suspend-") as folder:
        whole = Path(folder) / path.name
        fill(whole)
        if descriptor is None:
            target = open(path, "wb", buffering=0)  # noqa: SIM115 (closed below)
        else:
            sys.stdout.flush()
            target = os.fdopen(os.dup(descriptor), "wb", buffering=0)
        with target, open(whole, "rb") as source:
            while piece := source.read(_PIECE):
                write_all(target, piece)


def replace_text(path: Path, text: str, *, sync: bool = True) -> None:
    """Write `text` as UTF-8, as `replace_atomically`; bytes of file names that are no text appear as \\udcXX."""
    data = text.encode("utf-8", "backslashreplace")
    replace_atomically(path, lambda temporary: write_bytes(temporary, [data]), sync=sync)


def write_bytes(path: Path, chunks: Iterator[bytes | memoryview] | list) -> None:
    """Write the chunks to a new file at `path`. Raises OSError."""
    with open(path, "wb", buffering=0) as handle:
        for chunk in chunks:
            write_all(handle, chunk)


def write_all(handle: BinaryIO, data: bytes | memoryview) -> None:
    """Write all of `data` to an unbuffered file: normally one system call. Raises OSError."""
    view = memoryview(data).cast("B")
    while view.nbytes:
        view = view[handle.write(view) :]


def append_or_restore(path: Path, pieces: list[bytes | memoryview]) -> None:
    """Append the pieces to `path` (created when absent); on an error cut the file back."""
    with open(path, "ab", buffering=0) as handle:
        length = os.fstat(handle.fileno()).st_size
        try:
            for piece in pieces:
                write_all(handle, piece)
        except BaseException:
            with suppress(OSError):
                os.ftruncate(handle.fileno(), length)
            raise


def sync_path(path: Path) -> None:
    """Force a file or folder to the device (fsync). Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove_temporaries(directory: Path, names: Iterable[str]) -> None:
    """Remove temporary files that a killed writer of the files `names` left behind, and very old ones of any file.

    Call with the lock held under which these files are written: others in the folder may be written just now. Raises
    OSError.
    """
    for stale in directory.glob("*" + TEMPORARY):
        own = any(stale.name.startswith(f"{name}.") for name in names)
        with suppress(FileNotFoundError):
            if own or time.time() - stale.stat().st_mtime > STALE:
                stale.unlink()


class InUseError(StorageError):
    """Another process holds the lock of a folder (exit code 4)."""


class DirectoryLock:
    """Exclusive use of a run directory, by flock on `run.lock`; the kernel releases it when the process dies.

    The file stays behind (removing a lock file is a race); its content names the last holder.
    Raises InUseError, a StorageError, when another process holds it. `note` tells when the file system has no locks.
    """

    NAME = "run.lock"

    def __init__(self, directory: Path, patience: float = 0.5):
        self.note = ""
        path = directory / self.NAME
        with storage_errors("lock", path):
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            self._acquire(path, patience)
        except BaseException:
            os.close(self._descriptor)
            raise

    def _acquire(self, path: Path, patience: float) -> None:
        deadline = time.monotonic() + patience  # `holder` below takes the lock for an instant
        while True:
            try:
                fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError as error:
                if time.monotonic() > deadline:
                    raise InUseError(
                        f"{path.parent} is in use by another run ({_holder_text(path)}): wait for it, "
                        "stop it, or choose another output directory"
                    ) from error
                time.sleep(0.02)
            except OSError as error:
                if error.errno not in (errno.ENOSYS, errno.ENOTSUP, errno.ENOLCK):
                    raise StorageError(f"cannot lock {path}: {error.strerror}") from error
                self.note = (
                    f"{path.parent}: this file system has no locks; make sure no other run writes there"
                )
                break
        with storage_errors("write", path):
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, f"pid {os.getpid()} on {socket.gethostname()}\n".encode(), 0)

    def release(self) -> None:
        """Give the directory free; harmless when done twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def holder(directory: Path, name: str = DirectoryLock.NAME) -> str | None:
    """Who is writing in `directory` ("pid 17 on host"), or None; `name` is that of the lock."""
    path = directory / name
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _holder_text(path)
    except OSError:
        return None
    finally:
        os.close(descriptor)
    return None


def _holder_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip() or "holder unknown"
    except (OSError, UnicodeDecodeError):
        return "holder unknown"
