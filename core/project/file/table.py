"""A table of a project file: values with the type they must have, and one clear line when they have not."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from ...errors import ProjectError

T = TypeVar("T")


class Table:
    """A TOML table that knows its place in the file and which of its keys have been read.

    Parameters
    ----------
    file
        The project file; paths in it are relative to its folder.
    values
        The table as parsed.
    key
        Its key, for messages.
    """

    def __init__(self, file: Path, values: Mapping[str, Any], key: str = ""):
        self.file = file
        self.values = values
        self.key = key
        self._read: set[str] = set()

    def fail(self, key: str, reason: str) -> NoReturn:
        """Raise the ProjectError for a key of this table."""
        raise ProjectError(self.file, f"{self.key}.{key}".strip("."), reason)

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def get(self, key: str, default: Any = None) -> Any:
        """Value of a key, whatever it is."""
        self._read.add(key)
        return self.values.get(key, default)

    def typed(self, key: str, kind: type[T], what: str, default: T | None = None) -> T:
        """Value of a key that must be of a type; without default it has to be there."""
        value = self.get(key, default)
        if value is None:
            self.fail(key, f"is missing; give {what}")
        if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
            self.fail(key, f"has to be {what}, not {described(value)}")
        return value

    def text(self, key: str, default: str | None = None) -> str:
        """Text that is not empty."""
        value = self.typed(key, str, "a text", default)
        if not value and default != "":
            self.fail(key, "is empty")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """Truth value."""
        return self.typed(key, bool, "true or false", default)

    def choice(self, key: str, options: Iterable[str], default: str) -> str:
        """One of some words."""
        value = self.text(key, default)
        if value not in (known := list(options)):
            self.fail(key, f"has to be one of {', '.join(known)}, not “{value}”{meant(value, known)}")
        return value

    def words(self, key: str, options: Iterable[str]) -> tuple[str, ...]:
        """Return a list of words that are all known; empty when it is not there."""
        values, known = self.get(key, []), list(options)
        if not isinstance(values, list):
            self.fail(key, f"has to be a list of {', '.join(known)}, not {described(values)}")
        for value in values:
            if value not in known:
                self.fail(key, f"knows {', '.join(known)}, not {described(value)}{meant(str(value), known)}")
        return tuple(values)

    def number(
        self, key: str, low: float = -math.inf, high: float = math.inf, default: float | None = None
    ) -> float:
        """Finite number within bounds."""
        value = self.get(key, default)
        if value is None:
            self.fail(key, "is missing; give a number")
        return self._in_range(key, value, low, high)

    def numbers(self, key: str, counts: Iterable[int] | None = None) -> tuple[float, ...]:
        """Return a list of finite numbers, as many as one of `counts`."""
        values = self.get(key)
        if not isinstance(values, list):
            self.fail(key, f"has to be a list of numbers, not {described(values)}")
        allowed = None if counts is None else list(counts)
        if allowed is not None and len(values) not in allowed:
            self.fail(key, f"needs {' or '.join(map(str, allowed))} numbers, not {len(values)}")
        return tuple(self._in_range(key, value, -math.inf, math.inf) for value in values)

    def matrix(self, key: str, rows: int, columns: int) -> list[list[float]]:
        """Return rows of finite numbers."""
        values = self.get(key)
        shaped = isinstance(values, list) and len(values) == rows
        if not shaped or any(not isinstance(row, list) or len(row) != columns for row in values):
            self.fail(key, f"has to be {rows} rows of {columns} numbers")
        return [[self._in_range(key, x, -math.inf, math.inf) for x in row] for row in values]

    def path(self, key: str) -> Path:
        """Return a file that has to exist."""
        return self.existing(key, self.text(key))

    def paths(self, key: str) -> tuple[Path, ...]:
        """Return a list of files that have to exist."""
        values = self.get(key, [])
        if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
            self.fail(key, f"has to be a list of files, not {described(values)}")
        return tuple(self.existing(key, value) for value in values)

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts; empty when it is not there."""
        values = self.get(key, [])
        if not isinstance(values, list) or not all(isinstance(value, str) and value for value in values):
            self.fail(key, f"has to be a list of texts, not {described(values)}")
        return tuple(values)

    def existing(self, key: str, name: str) -> Path:
        """Path of a file named relative to the project file; it has to exist."""
        path = self.resolve(name)
        if not path.is_file():
            self.fail(key, f"there is no file {path}")
        return path

    def resolve(self, name: str) -> Path:
        """Path named relative to the project file."""
        return self.file.parent / Path(name)

    def existing_any(self, key: str) -> Path:
        """Return a file or folder that has to exist."""
        path = self.resolve(self.text(key))
        if not path.exists():
            self.fail(key, f"there is no file or folder {path}")
        return path

    def table(self, key: str, required: bool = False) -> Table:
        """Sub-table, empty when it is not there."""
        return Table(self.file, self.typed(key, dict, "a table", None if required else {}), self._path(key))

    def tables(self, key: str) -> list[Table]:
        """Return the tables of an array of tables ([[key]]), numbered from 1 in messages."""
        values = self.get(key, [])
        if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
            self.fail(key, f"has to be written as [[{key}]]")
        return [Table(self.file, value, f"{self._path(key)}[{n}]") for n, value in enumerate(values, 1)]

    def offer(self, keys: Iterable[str]) -> None:
        """Count keys as known although they were not asked for."""
        self._read.update(keys)

    def finish(self) -> None:
        """Refuse keys that nobody knows: a misspelt setting must not be ignored."""
        for key in self.values:
            if key not in self._read:
                close = meant(key, self._read)
                advice = f"{close} If not, take it out" if close else f"{hint(key, self._read)}; take it out"
                self.fail(key, f"is not known here{advice}")

    def _path(self, key: str) -> str:
        return f"{self.key}.{key}".strip(".")

    def _in_range(self, key: str, value: Any, low: float, high: float) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.fail(key, f"has to be a number, not {described(value)}")
        if not math.isfinite(value) or not low <= value <= high:
            self.fail(key, f"is {value:g}, but has to be {_bounds(low, high)}")
        return float(value)


def _bounds(low: float, high: float) -> str:
    if math.isinf(low) and math.isinf(high):
        return "a finite number"
    if math.isinf(high):
        return f"at least {low:g}"
    return f"at most {high:g}" if math.isinf(low) else f"from {low:g} to {high:g}"


def described(value: Any) -> str:
    """How a message shows a wrong value."""
    names = {dict: "a table", list: "a list", bool: str(value).lower(), type(None): "nothing"}
    return names.get(type(value), f"“{value}”" if isinstance(value, str) else str(value))


def meant(word: str, known: Iterable[str]) -> str:
    """“; did you mean …?” when a known word is close, else nothing."""
    close = difflib.get_close_matches(word, sorted(set(known)), n=1, cutoff=0.6)
    return f"; did you mean “{close[0]}”?" if close else ""


def hint(word: str, known: Iterable[str]) -> str:
    """“; did you mean …?” when a known word is close, else what there is."""
    words = sorted(set(known))
    return meant(word, words) or (f" (there is: {', '.join(words)})" if words else "")
