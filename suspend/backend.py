"""matplotlib, importable whatever the environment names as its backend.

The figures are drawn into files by a canvas of their own and need no backend. A shell opened from a notebook has
MPLBACKEND set to the notebook's, which matplotlib refuses at its first import where the notebook's packages are absent.
"""

from __future__ import annotations

import os
import sys

_VARIABLE = "MPLBACKEND"


def load_matplotlib() -> None:
    """Import matplotlib; to be called before any other import from it.

    A backend that works, as in a notebook, is left to the user, and so is a matplotlib imported before. One that
    matplotlib refuses is set aside for the import only.
    """
    try:
        import matplotlib  # noqa: F401
    except ValueError:
        if _VARIABLE not in os.environ:
            raise
        _import_without_backend()


def _import_without_backend() -> None:
    _forget_half_imported()
    backend = os.environ.pop(_VARIABLE)
    try:
        import matplotlib  # noqa: F401
    finally:
        os.environ[_VARIABLE] = backend


def _forget_half_imported() -> None:
    """The submodules of the failed import hold on to a package that is gone; compiled ones cannot be loaded twice."""
    for name, module in list(sys.modules.items()):
        source = getattr(module, "__file__", None) or ""
        if name.partition(".")[0] == "matplotlib" and source.endswith(".py"):
            del sys.modules[name]
