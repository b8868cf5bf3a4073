"""What every analysed quantity offers: parameters in, `compute(run)`, results as properties, `plot(ax)`."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from typing import Any, Self

import numpy as np

from suspend.io.csv_text import write_csv_file


class Quantity(ABC):
    """Base of the quantities of `suspend.analysis`.

    The constructor takes parameters, `compute` takes data and returns the object itself, properties are results in
    the units their docstrings name, `table` gives the columns of the CSV behind the figure that `plot` draws.
    """

    @abstractmethod
    def compute(self, run) -> Self:
        """Compute from an open `suspend.io.Run`."""

    @abstractmethod
    def table(self) -> dict[str, np.ndarray]:
        """Columns of equal length by "name[unit]"."""

    def plot(self, ax) -> None:
        """Draw into matplotlib axes."""
        raise NotImplementedError(f"{type(self).__name__} has no figure of its own")

    def summary(self) -> dict[str, Any]:
        """Scalars (and their errors) by name, for JSON and reports."""
        return {}

    def write_csv(self, path: os.PathLike | str) -> None:
        """Write `table` with a header line; atomic. Raises StorageError."""
        columns = self.table()
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        write_csv_file(path, [columns, *rows])
