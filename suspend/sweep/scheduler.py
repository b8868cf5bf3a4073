"""The connection to a running Dask scheduler, given by its address or its scheduler file."""

from __future__ import annotations

import json
import logging
import os
import socket
import warnings
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

from distributed import Client
from distributed.versions import VersionMismatchWarning

from suspend.errors import ConfigurationError, StorageError

CONNECT = 10.0  # seconds in which a scheduler answers
SCHEMES = ("tcp", "tls", "ws", "wss", "ucx", "ucxx")
PLACES = "tcp://HOST:8786 or the path of a scheduler file"


def connect(scheduler: str) -> Client:
    """The scheduler at an address or named by a scheduler file. Raises ConfigurationError, StorageError."""
    silence()
    address = _address(scheduler)
    try:
        parts = urlsplit(address)
        if parts.scheme not in SCHEMES:
            raise ValueError(f"{parts.scheme}:// is none of Dask's protocols")
        if parts.scheme in ("tcp", "tls"):  # heard of at once; Dask goes on trying
            socket.create_connection((parts.hostname, parts.port), timeout=CONNECT).close()
        return Client(address, timeout=CONNECT, set_as_default=False, name="suspend-sweep")
    except (OSError, ValueError, TypeError, ImportError) as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise ConfigurationError(
            f"--scheduler {scheduler}: no Dask scheduler answers there ({reason[0]}): start one with `dask scheduler`, "
            f"or give {PLACES}; nothing was started"
        ) from error


def silence() -> None:
    """Keep Dask's words off the screen: what the user must know is said by the sweep, which examines every worker."""
    warnings.filterwarnings("ignore", category=VersionMismatchWarning)
    for name in ["distributed", *logging.root.manager.loggerDict]:
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _address(scheduler: str) -> str:
    """The address of a scheduler, from its file where it is one."""
    if "://" in scheduler:
        return scheduler
    path = Path(scheduler)
    if path.is_file():
        with suppress(OSError, ValueError, KeyError, TypeError):
            return str(json.loads(path.read_text(encoding="utf-8"))["address"])
        raise StorageError(f"--scheduler {scheduler}: is no scheduler file; give {PLACES}; nothing was started")
    if os.sep not in scheduler and scheduler.rpartition(":")[2].isdecimal():
        return f"tcp://{scheduler}"
    raise StorageError(f"--scheduler {scheduler}: there is no such scheduler file; give {PLACES}; nothing was started")
