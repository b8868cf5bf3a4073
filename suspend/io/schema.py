"""Which field of a cycle's record belongs to which table of the trajectory, and what a record must satisfy.

Four tables: samples (n rows a cycle: time series), frames (K rows a cycle: positions), cycles (one row) and
statistics (one row a cycle: the solver's, and d_cyc, relative to the mean displacement as in the analysis). Fields not
named below are time series with n rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

FRAME_FIELDS = ("frame_time", "frame_strain", "frame_phase", "tilt", "position", "image", "unwrapped")
CYCLE_FIELDS = ("index", "complete")
SAMPLE_FIELDS = ("time", "strain", "rate", "phase")  # always there, with the stresses besides
STEPS_PER_CYCLE = 1_000_000  # H5MD wants integer steps: millionths of a cycle since the start


def sample_fields(record: dict) -> list[str]:
    """Names of the time series of a record."""
    fixed = {*FRAME_FIELDS, *CYCLE_FIELDS, "statistics"}
    return [name for name in record if name not in fixed]


def steps(cycle: int, phase: np.ndarray) -> np.ndarray:
    """Integer H5MD step of each phase (fraction of a cycle, 0 to 1) in `cycle`."""
    return cycle * STEPS_PER_CYCLE + np.rint(np.asarray(phase) * STEPS_PER_CYCLE).astype(np.int64)


class Field(NamedTuple):
    """Type and shape of one row of a field."""

    kind: str
    dtype: str
    shape: tuple[int, ...]


def schema_of(record: dict) -> dict[str, Field]:
    """Types and row shapes of all fields of a record; statistics as "statistics/NAME"."""
    fields = {}
    for name in [*sample_fields(record), *FRAME_FIELDS]:
        array = np.asarray(record[name])
        fields[name] = Field("row", array.dtype.str, array.shape[1:])
    for name, value in record["statistics"].items():
        fields["statistics/" + name] = Field("scalar", np.asarray(value).dtype.str, np.shape(value))
    return fields


def check_record(record: dict, number: int, schema: dict[str, Field] | None) -> dict[str, Field]:
    """Check a record against itself, the number of spheres and the run's schema; returns its schema.

    Raises ValueError (an error of the calling program, not of the user) and names the field.
    """
    missing = [n for n in (*CYCLE_FIELDS, *SAMPLE_FIELDS, *FRAME_FIELDS, "statistics") if n not in record]
    if missing:
        raise ValueError(f"record lacks {', '.join(missing)}")
    n, k = len(record["time"]), len(record["frame_time"])
    if n == 0 or k == 0:
        raise ValueError(f"cycle {record['index']}: a record needs at least one sample and one frame")
    for names, rows in ((sample_fields(record), n), (FRAME_FIELDS, k)):
        for name in names:
            if np.ndim(record[name]) == 0 or len(record[name]) != rows:
                raise ValueError(f"{name} has shape {np.shape(record[name])}, expected {rows} rows")
    for name in ("position", "image", "unwrapped"):
        if np.shape(record[name]) != (k, number, 3):
            raise ValueError(f"{name} has shape {np.shape(record[name])}, expected {(k, number, 3)}")
    found = schema_of(record)
    wrong = [
        n for n, f in found.items() if np.dtype(f.dtype).kind not in "bif" or (f.kind == "scalar" and f.shape)
    ]
    if wrong:
        raise ValueError(f"{', '.join(wrong)}: only real, integer and boolean numbers can be stored")
    if schema is not None and found != schema:
        odd = [name for name in {**schema, **found} if schema.get(name) != found.get(name)]
        raise ValueError(f"cycle {record['index']} differs from the cycles before in {', '.join(odd)}")
    return found
