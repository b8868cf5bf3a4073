"""The cache of compiled kernels: what it cannot give is compiled, and nothing stale is served."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import suspend

CALLER = """from suspend.core.callee import f
from suspend.core.jit import kernel


@kernel
def g(x):
    return f(x) + 1.0
"""
CALLEE = "from suspend.core.jit import kernel\n\n@kernel\ndef f(x):\n    return {} * x\n"


@pytest.fixture
def package(tmp_path):
    """A copy of the package with two small kernels, one calling the other from another file."""
    source = Path(suspend.__file__).parent
    shutil.copytree(source, tmp_path / "code" / "suspend", ignore=shutil.ignore_patterns("__pycache__"))
    core = tmp_path / "code" / "suspend" / "core"
    (core / "caller.py").write_text(CALLER)
    (core / "callee.py").write_text(CALLEE.format("2.0"))
    return tmp_path


def compute(package, cache=None):
    """g(3) in a process of its own and what it says on stderr; the cache only in `cache`."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(package / "code"),
        "NUMBA_CACHE_DIR": str(cache or package / "cache"),
        "NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator",
    }
    code = "from suspend.core.caller import g; print(g(3.0), sum(g.stats.cache_hits.values()))"
    done = subprocess.run([sys.executable, "-c", code], env=environment, cwd=package, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    value, hits = done.stdout.split()
    return float(value), int(hits), done.stderr


def test_an_edited_callee_is_not_served_stale(package):
    """A kernel holds the code of those it calls: editing one in another file renews it; otherwise it is a hit."""
    assert compute(package) == (7.0, 0, "")
    assert compute(package) == (7.0, 1, "")
    (package / "code" / "suspend" / "core" / "callee.py").write_text(CALLEE.format("5.0"))
    assert compute(package)[0] == 16.0


def test_without_a_folder_the_kernels_are_compiled(package):
    """No place for the cache: one line with the folder and the remedy, and the result."""
    (package / "file").write_text("")
    value, _, said = compute(package, package / "file" / "below")
    assert value == 7.0
    assert said.count("\n") == 1 and str(package / "file") in said and "NUMBA_CACHE_DIR" in said


@pytest.mark.parametrize(("suffix", "content"), [("nbi", b""), ("nbi", b"\x80"), ("nbc", None), ("nbc", b"")])
def test_damaged_files_are_renewed(package, suffix, content):
    """Empty or cut files: one line, the result, and the cache whole again for the next process."""
    compute(package)
    for path in (package / "cache").rglob(f"*.{suffix}"):
        path.write_bytes(path.read_bytes()[:100] if content is None else content)
    value, _, said = compute(package)
    assert value == 7.0 and said.count("\n") == 1 and str(package / "cache") in said
    assert compute(package) == (7.0, 1, "")


def test_a_full_disk_is_no_error(package):
    """Files cannot be written (limit of their size): one line, the result."""
    limit = "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
    limit += "resource.setrlimit(resource.RLIMIT_FSIZE, (50, 50)); "
    environment = {**os.environ, "PYTHONPATH": str(package / "code"), "NUMBA_CACHE_DIR": str(package / "cache")}
    code = limit + "from suspend.core.caller import g; print(g(3.0))"
    command = [sys.executable, "-B", "-c", code]
    done = subprocess.run(command, env=environment, cwd=package, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "7.0\n"), done.stderr
    assert done.stderr.count("\n") == 1 and str(package / "cache") in done.stderr
