"""Quantities without a value: D_cyc of one sphere, the smallest gap where no two spheres are near, ...

One convention for each medium:
    NumPy, HDF5, netCDF, GSD, data frames   NaN in an array of real numbers, which h5py, xarray and pandas take for
                                            missing; an attribute, or an array of which nothing exists, is left out
    plain Python, JSON                      None, null
    CSV                                     an empty cell
    terminal                                "-"; on the report's page an en dash
Nothing that is written holds an infinity. Older files do (the smallest gap of a cycle): it is read as missing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

DASH = "-"  # in text
NOTE = "NaN: the quantity has no value here; no infinities are stored"  # an attribute of HDF5 files


def has_value(value: Any) -> bool:
    """False for None, not-a-numbers and infinities."""
    return value is not None and not (isinstance(value, float | np.floating) and not math.isfinite(value))


def known(values: Any) -> Any:
    """The numbers as they are stored: infinities, which stand for no value, become NaN; integers stay as they are."""
    if isinstance(values, np.ndarray) and values.dtype.kind == "f":
        return np.where(np.isfinite(values), values, values.dtype.type(np.nan))
    if isinstance(values, np.ndarray):
        return values
    return values if has_value(values) or values is None else math.nan


def smallest(values: Any) -> float:
    """The smallest of the numbers that have a value, NaN where none has."""
    values = np.asarray(values, float)
    return float(np.min(values[np.isfinite(values)], initial=np.inf)) if np.isfinite(values).any() else math.nan


def largest(values: Any) -> float:
    """The largest of the numbers that have a value, NaN where none has."""
    return -smallest(-np.asarray(values, float))


def plain(value: Any) -> Any:
    """Nested values as plain types fit for JSON: what has no value is None, arrays are lists, other objects text."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, str | int | float | None):
        return value if has_value(value) else None
    return str(value)


def text(value: float | None, form: str = ".6g", unit: str = "") -> str:
    """A number in a format as `format` knows them, with its unit behind it; a dash where there is no value."""
    return f"{value:{form}}{unit}" if has_value(value) else DASH
