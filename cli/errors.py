"""From exceptions to one message on stderr and an exit code."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import traceback
from typing import NoReturn

import click

from suspend.errors import Interrupted, NumericalError, StorageError, SuspendError


def guarded(cli: click.Command, arguments: list[str] | None) -> NoReturn:
    """Run `cli` and exit: 0, or 2 usage, the code of a SuspendError, 130 interrupted, 1 a defect of ours."""
    code = 1
    _accept_any_name()
    try:
        code = cli.main(args=arguments, prog_name="suspend", standalone_mode=False)
        code = code if isinstance(code, int) else 0
        sys.stdout.flush()
    except click.exceptions.Abort:
        code = _complain("interrupted", Interrupted.exit_code)
    except KeyboardInterrupt:
        code = _complain("interrupted", Interrupted.exit_code)
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except SuspendError as error:
        code = _complain(str(error), error.exit_code)
    except BrokenPipeError:
        code = _reader_gone()
    except MemoryError as error:
        message = f"not enough memory ({error}); `suspend run CONFIG --dry-run` prints what a run needs"
        code = _complain(message, NumericalError.exit_code)
    except OSError as error:
        code = _complain(f"a file or folder cannot be read or written: {error}", StorageError.exit_code)
    except Exception:
        traceback.print_exc()
        print("This is a defect of suspend: please report it with the lines above.", file=sys.stderr)
    with contextlib.suppress(OSError):
        sys.stderr.flush()
    sys.exit(code)


def _accept_any_name() -> None:
    """Print names of files that are no text byte for byte, as `ls` does; Python alone would refuse them."""
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="surrogateescape")


def _complain(message: str, code: int) -> int:
    if os.environ.get("SUSPEND_DEBUG", "") not in ("", "0"):
        traceback.print_exc()
    with contextlib.suppress(OSError):
        print(f"Error: {message}", file=sys.stderr)
    # What is still buffered may be what cannot be written: no second complaint from the interpreter at exit.
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
        return code
    _silence_stdout()
    return code


def _reader_gone() -> int:
    """`suspend ... | head` closed the pipe: quiet, and 1 as click exits on a closed pipe."""
    _silence_stdout()
    return 1


def _silence_stdout() -> None:
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
