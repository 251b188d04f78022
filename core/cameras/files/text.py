"""Reading camera files: what is missing or wrong is said with the file's name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ...arrays import FloatArray
from ...errors import CameraError
from ...files import replacing


def read_bytes(path: Path | str) -> bytes:
    """Content of a file, or CameraError saying why it cannot be read."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise CameraError(f"{path} cannot be read: {error.strerror}.") from error


def read_text(path: Path | str) -> str:
    """Text of a file in UTF-8, or CameraError."""
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CameraError(f"{path} is not a text file.") from error


def read_xml(path: Path | str) -> ElementTree.Element:
    """Root of an XML file, or CameraError saying where it is broken."""
    try:
        return ElementTree.fromstring(read_text(path).encode())
    except ElementTree.ParseError as error:
        raise CameraError(f"{path} is not a complete XML file ({error}).") from error


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write a file at one stroke, its folder too if it is missing; OutputError if it fails."""
    with replacing(path) as file:
        file.write(content)


def write_text(path: Path | str, content: str) -> None:
    """Write a UTF-8 text file at one stroke; OutputError if it fails."""
    write_bytes(path, content.encode())


def numbers(words: Sequence[Any] | str | None, what: str, count: int | None = None) -> FloatArray:
    """Finite numbers from words or a string of words, `count` of them, or CameraError naming `what`."""
    if isinstance(words, str):
        words = words.split()
    try:
        values = np.array([float(word) for word in words or ()])
    except (TypeError, ValueError) as error:
        raise CameraError(f"{what}: expected numbers.") from error
    if not np.all(np.isfinite(values)):
        raise CameraError(f"{what}: the numbers must be finite.")
    if count is not None and values.size != count:
        raise CameraError(f"{what}: expected {count} numbers, found {values.size}.")
    return values


def number(word: Any, what: str) -> float:
    """One finite number, or CameraError naming `what`."""
    return float(numbers([word], what, 1)[0])


def whole(word: Any, what: str) -> int:
    """One whole number, or CameraError naming `what`."""
    value = number(word, what)
    if value != int(value):
        raise CameraError(f"{what}: expected a whole number, found {word}.")
    return int(value)


def entry(table: Mapping[str, Any], key: str, what: str) -> Any:
    """Value of a key, or CameraError naming `what` it is missing from."""
    if not isinstance(table, Mapping) or key not in table:
        raise CameraError(f"{what}: '{key}' is missing.")
    return table[key]


def exact(value: float) -> str:
    """Shortest decimal that reads back as the same number."""
    return repr(float(value))
