"""What a figure is made of: panels, each with its data, its drawing and the columns of its CSV."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure

    from suspend.figures.runs import Runs

Columns = dict[str, np.ndarray]


class Panel(ABC):
    """One panel: computed from the runs when it is made, drawn into its own part of the page.

    `tables` holds the columns "name[unit]" of everything that is drawn, one table for the panel and one for each
    inset, by the suffix of the file's name ("" for the first).
    """

    aspect: ClassVar[float] = 1.0  # width relative to the other panels of a row

    @abstractmethod
    def __init__(self, runs: Runs, **options):
        """Compute. Raises ConfigurationError where the runs lack what is needed."""

    @property
    def size(self) -> tuple[float, float] | None:
        """Width and height in inches where the content decides; None: that of the figure's kind."""
        return None

    @abstractmethod
    def draw(self, page: SubFigure) -> None:
        """Make axes on `page` and draw; the first axes made bear the letter."""

    @abstractmethod
    def tables(self) -> dict[str, Columns]:
        """Columns of equal length by "name[unit]", for each table by its suffix."""


def stack(parts: list[Columns]) -> Columns:
    """Tables with the same columns below one another; {} for none."""
    return {name: np.concatenate([np.atleast_1d(part[name]) for part in parts]) for name in parts[0]} if parts else {}


def labelled(constants: dict[str, object], columns: Columns) -> Columns:
    """The columns with constant ones in front, by header."""
    rows = len(next(iter(columns.values())))
    return {name: np.full(rows, value) for name, value in constants.items()} | columns
