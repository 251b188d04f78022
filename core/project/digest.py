"""Fingerprints of inputs: the same fingerprint means the same result."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

_CORE = Path(__file__).resolve().parents[1]

FINGERPRINT = "BLAKE2b, 16 bytes"
"""The algorithm of all fingerprints, for those who want to check a file: `b2sum -l 128 FILE`."""


def digest(*items: Any) -> str:
    """Fingerprint of arrays, texts, numbers, mappings, dataclasses and sequences of them."""
    sum_ = hashlib.blake2b(digest_size=16)
    for item in items:
        _feed(sum_, item)
    return sum_.hexdigest()


def file_digest(path: Path, data: bytes | None = None) -> str:
    """Fingerprint of a file's contents; `data` may hold them when they have been read already."""
    if data is not None:
        return hashlib.blake2b(data, digest_size=16).hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


@cache
def code_digest() -> str:
    """Fingerprint of the computing code: another version of it must not take over old results."""
    return digest([path.read_text(encoding="utf-8") for path in sorted(_CORE.rglob("*.py"))])


def _feed(sum_: hashlib.blake2b, item: Any) -> None:
    if isinstance(item, np.ndarray):
        sum_.update(f"{item.dtype.str}{item.shape}".encode())
        sum_.update(np.ascontiguousarray(item).tobytes())
    elif dataclasses.is_dataclass(item):
        _feed(sum_, {f.name: getattr(item, f.name) for f in dataclasses.fields(item)})
    elif isinstance(item, Mapping):
        for key in sorted(item, key=str):
            _feed(sum_, str(key))
            _feed(sum_, item[key])
        sum_.update(b"}")
    elif isinstance(item, (list, tuple)):
        for part in item:
            _feed(sum_, part)
        sum_.update(b"]")
    else:
        sum_.update(json.dumps(item, default=str).encode() + b"\0")
