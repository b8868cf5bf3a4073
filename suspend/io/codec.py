"""Nested dictionaries of arrays and scalars as flat tables and as bytes, every bit kept, nothing pickled."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

_LENGTH = struct.Struct("<Q")


def flatten(tree: dict) -> tuple[dict[str, list | None], dict[str, np.ndarray]]:
    """Split a nested dict into a JSON-able skeleton and its arrays, both keyed by "outer/inner" paths.

    The skeleton holds [value] for a scalar (int of any size, float, bool, str, None, list of those) and None
    for an array. NumPy scalars become Python scalars of the same value, tuples lists. Raises TypeError for
    anything else (objects, bytes, arrays of objects) and for keys that are no plain strings.
    """
    skeleton: dict[str, list | None] = {}
    arrays: dict[str, np.ndarray] = {}
    _flatten_into(tree, "", skeleton, arrays)
    return skeleton, arrays


def _flatten_into(tree: dict, prefix: str, skeleton: dict, arrays: dict) -> None:
    for key, value in tree.items():
        if not isinstance(key, str) or not key or "/" in key:
            raise TypeError(f"key {key!r} under {prefix or 'the top'!r}: keys must be strings without '/'")
        path = prefix + key
        if isinstance(value, dict) and value:
            _flatten_into(value, path + "/", skeleton, arrays)
        elif isinstance(value, np.ndarray):
            if value.dtype.hasobject:
                raise TypeError(f"{path}: arrays of Python objects cannot be stored")
            skeleton[path] = None
            # ascontiguousarray would turn a 0-d array into a 1-d one
            arrays[path] = np.asarray(value, order="C")
        else:
            skeleton[path] = [_scalar(value, path)]


def _scalar(value: Any, path: str) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, (list, tuple)):
        return [_scalar(item, path) for item in value]
    if value is None or isinstance(value, (bool, int, float, str)) or value == {}:
        return value
    raise TypeError(f"{path}: cannot store a {type(value).__name__}")


def unflatten(skeleton: dict[str, list | None], arrays: dict[str, np.ndarray]) -> dict:
    """Rebuild the nested dict from `flatten`, in the same key order."""
    tree: dict = {}
    for path, wrapped in skeleton.items():
        *outer, last = path.split("/")
        node = tree
        for key in outer:
            node = node.setdefault(key, {})
        node[last] = arrays[path] if wrapped is None else wrapped[0]
    return tree


def pack(tree: dict) -> list[bytes | memoryview]:
    """Bytes of a nested dict in pieces: header length, header (JSON: skeleton, dtypes, shapes), raw arrays.

    The pieces share memory with the arrays.
    """
    skeleton, arrays = flatten(tree)
    listing = [[path, array.dtype.str, list(array.shape)] for path, array in arrays.items()]
    header = json.dumps({"skeleton": skeleton, "arrays": listing}).encode()
    raw = [memoryview(array.reshape(-1).view(np.uint8)) for array in arrays.values()]
    return [_LENGTH.pack(len(header)) + header, *raw]


def unpack(data: bytes | memoryview) -> dict:
    """Inverse of `pack` (pieces joined); the arrays are copies. Raises ValueError where bytes remain."""
    view = memoryview(data)
    start = _LENGTH.size + _LENGTH.unpack_from(view)[0]
    header = json.loads(bytes(view[_LENGTH.size : start]))
    arrays = {}
    for path, dtype, shape in header["arrays"]:
        dtype = np.dtype(dtype)
        count = int(np.prod(shape, dtype=np.int64))
        stop = start + count * dtype.itemsize
        arrays[path] = np.empty(shape, dtype)
        arrays[path].reshape(-1).view(np.uint8)[:] = np.frombuffer(view[start:stop], np.uint8)
        start = stop
    if start != len(view):
        raise ValueError(f"{len(view) - start} bytes left over")
    return unflatten(header["skeleton"], arrays)
