"""Sizes of memory as people write them."""

from __future__ import annotations

import re

LEAST = 1e6  # bytes: less is a slip of the pen
_SIZE = re.compile(r"([0-9]*\.?[0-9]+) *([KMGT]i?)?B?", re.ASCII | re.IGNORECASE)
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12}
_UNITS |= {f"{prefix}i": 1024**power for power, prefix in enumerate("kmgt", 1)}


def memory_bytes(text: str) -> float | None:
    """Bytes of 8 GB, 500 MB, 2 GiB; None for what is no size of at least 1 MB."""
    match = _SIZE.fullmatch(text.strip())
    size = float(match.group(1)) * _UNITS[(match.group(2) or "").lower()] if match else 0.0
    return size if size >= LEAST else None
