"""`checkpoint.npz`: everything a run needs to continue, in one file that NumPy opens without pickle."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import numpy as np

from suspend.conventions import FORMAT_VERSION
from suspend.errors import StorageError
from suspend.io.codec import flatten, unflatten
from suspend.io.files import replace_atomically, storage_errors, write_bytes

_SKELETON = "skeleton.json"  # the scalars and the order of the keys; arrays are entries of their own
_EPOCH = (1980, 1, 1, 0, 0, 0)  # a fixed time stamp: equal states give equal files


def encode_checkpoint(content: dict) -> bytes:
    """Bytes of an uncompressed .npz with the nested dict `content` (see `codec.flatten` for its limits)."""
    skeleton, arrays = flatten({"format_version": FORMAT_VERSION, **content})
    buffer = io.BytesIO()
    # writestr of ready bytes is several times faster than numpy.savez for many small arrays
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for path, array in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, array, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(path + ".npy", _EPOCH), entry.getbuffer())
        text = np.frombuffer(json.dumps(skeleton).encode(), np.uint8)
        entry = io.BytesIO()
        np.lib.format.write_array(entry, text, allow_pickle=False)
        archive.writestr(zipfile.ZipInfo(_SKELETON + ".npy", _EPOCH), entry.getbuffer())
    return buffer.getvalue()


def write_checkpoint(path: Path, content: dict, *, sync: bool = False) -> None:
    """Replace the checkpoint atomically; `sync` also guards against a power cut. Raises StorageError."""
    data = encode_checkpoint(content)
    with storage_errors("write the checkpoint", path):
        replace_atomically(path, lambda temporary: write_bytes(temporary, [data]), sync=sync)


def read_checkpoint(source: Path | bytes, name: str = "") -> dict:
    """Content of a checkpoint file (or of its bytes), checksums verified.

    Raises StorageError where it is absent, damaged, of another program, or of a newer format.
    """
    name = name or str(source)
    with storage_errors("read the checkpoint", name):
        data = source if isinstance(source, bytes) else source.read_bytes()
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            skeleton = json.loads(_entry(archive, _SKELETON).tobytes())
            arrays = {path: _entry(archive, path) for path, value in skeleton.items() if value is None}
            content = unflatten(skeleton, arrays)
        version = content.pop("format_version")
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError, TypeError) as error:
        raise StorageError(f"{name} is damaged or no checkpoint of suspend ({error})") from error
    if version > FORMAT_VERSION:
        raise StorageError(
            f"{name} has format {version}, this version reads up to {FORMAT_VERSION}: use a newer suspend"
        )
    return content


def _entry(archive: zipfile.ZipFile, path: str) -> np.ndarray:
    # archive.read verifies the CRC of the entry, numpy.load alone would not
    return np.lib.format.read_array(io.BytesIO(archive.read(path + ".npy")), allow_pickle=False)
