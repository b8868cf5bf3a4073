"""Errors a user can cause or must act on, each with its exit code.

Every error says what happened, where, what was found and what to do. The command line prints the message
without a traceback and exits with `exit_code`.
"""

from __future__ import annotations


class SuspendError(Exception):
    """Base of all errors that end in one clear message. Exit code 1 where nothing more specific fits."""

    exit_code = 1


class ConfigurationError(SuspendError):
    """The configuration, the command line or the scene it describes is not usable (exit code 2)."""

    exit_code = 2


class NumericalError(SuspendError):
    """The computation cannot continue with the accuracy asked for (exit code 3)."""

    exit_code = 3


class StorageError(SuspendError):
    """A file or folder cannot be read or written, or is not what it should be (exit code 4)."""

    exit_code = 4


class Interrupted(SuspendError):
    """The run was stopped by a signal or a time limit; a checkpoint was written (exit code 130)."""

    exit_code = 130


def named(path: object, error: Exception) -> str:
    """The message of an error about `path`, with the path in front where it does not say it itself."""
    return str(error) if str(path) in str(error) else f"{path}: {error}"
