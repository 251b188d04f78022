"""Writing files so that a result is there completely or not at all."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .errors import OutputError

_REASONS = {
    errno.ENOSPC: "the disk is full; free some space and run again, finished stages are kept",
    errno.EDQUOT: "the disk quota is used up; free some space and run again, finished stages are kept",
    errno.EROFS: "the disk is read-only; choose another output folder",
    errno.EACCES: "no permission to write there; choose another output folder or change its permissions",
    errno.EPERM: "no permission to write there; choose another output folder or change its permissions",
}


def output_error(path: Path | str, error: OSError) -> OutputError:
    """Return the sentence for the user when `path` could not be written."""
    reason = _REASONS.get(error.errno or 0, error.strerror or str(error))
    return OutputError(f"{path}: cannot be written: {reason}")


@contextmanager
def replacing(path: Path | str) -> Iterator[BinaryIO]:
    """Write a file under a temporary name beside `path`, which it replaces only when all went well.

    Missing folders are made. Raises OutputError for a full disk, a read-only folder and the like.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=".", suffix=target.suffix + ".part", dir=target.parent)
    except OSError as error:
        raise output_error(target, error) from error
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        _publish(Path(name), target)
    except OSError as error:
        raise output_error(target, error) from error
    finally:
        Path(name).unlink(missing_ok=True)


def _publish(temporary: Path, target: Path) -> None:
    """Give the finished file its name, with the permissions of any new file instead of a private one's."""
    mask = os.umask(0)
    os.umask(mask)
    temporary.chmod(0o666 & ~mask)
    temporary.replace(target)
