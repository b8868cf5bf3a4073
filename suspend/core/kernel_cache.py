"""Numba's cache of compiled kernels, as a nicety: what it cannot give is compiled, after one line that says so.

A kernel holds the code of the kernels it calls, also of those in other files. So the stamp of an entry is that of all
sources with kernels, not of one file as Numba has it.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import sys
from pathlib import Path

from numba.core import config
from numba.core.caching import FunctionCache, IndexDataCacheFile

PACKAGE = Path(__file__).resolve().parents[1]
REMEDY = "set NUMBA_CACHE_DIR to a folder that can be written"
_said: set[str] = set()


def cached(dispatcher):
    """The dispatcher with a cache, or as it is where no folder can hold one."""
    try:
        dispatcher._cache = _Cache(dispatcher.py_func)
    except (RuntimeError, OSError):  # Numba's word for a cache without a place
        _say_once(
            f"no folder for the cache of compiled kernels ({config.CACHE_DIR or PACKAGE}): every start compiles, "
            f"about a minute; {REMEDY}"
        )
    return dispatcher


@functools.cache
def source_stamp() -> str:
    """Hash of all sources of the package that may hold kernels."""
    found = hashlib.sha256()
    for folder in ("core", "hydro", "solvers", "."):
        pattern = "*.py" if folder == "." else "**/*.py"
        for path in sorted((PACKAGE / folder).glob(pattern)):
            found.update(str(path.relative_to(PACKAGE)).encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()


class _File(IndexDataCacheFile):
    def load(self, key):
        """What is stored, None where nothing is or what there is is damaged; that is thrown away."""
        try:
            return super().load(key)
        except OSError as error:
            self._unusable(error)
        except Exception as error:  # a damaged pickle raises anything
            self._damaged(error)
        return None

    def save(self, key, data):
        """Store, or go on without."""
        try:
            super().save(key, data)
        except OSError as error:
            self._unusable(error)

    def _unusable(self, error: OSError) -> None:
        _say_once(
            f"the cache of compiled kernels in {self._cache_path} cannot be used ({error.strerror or error}): what "
            f"is missing is compiled at every start; make room or {REMEDY}"
        )

    def _damaged(self, error: Exception) -> None:
        _say_once(
            f"the cache of compiled kernels in {self._cache_path} is damaged ({type(error).__name__}): what cannot be "
            "read is compiled anew and stored again; if this line comes back, remove the folder's .nbi and .nbc files"
        )
        try:
            # Without its index the kernel's entries are written anew.
            os.unlink(self._index_path)
        except OSError as unlink_error:
            self._unusable(unlink_error)


class _Cache(FunctionCache):
    def __init__(self, function):
        super().__init__(function)
        self._cache_file = _File(self._cache_path, self._impl.filename_base, source_stamp())

    def _save_overload(self, sig, data):
        try:
            super()._save_overload(sig, data)
        except OSError as error:  # the folder is gone
            self._cache_file._unusable(error)

    def _load_overload(self, sig, target_context):
        if not self._enabled:
            return None
        data = self._cache_file.load(self._index_key(sig, target_context.codegen()))
        if data is None:
            return None
        try:
            return self._impl.rebuild(target_context, data)
        except Exception as error:  # a whole pickle of something else
            self._cache_file._damaged(error)
            return None


def _say_once(text: str) -> None:
    kind = re.sub(r"\(.*?\)", "", text)
    if kind not in _said:
        _said.add(kind)
        print(f"note: {text}", file=sys.stderr)
