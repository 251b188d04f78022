"""What a drone wrote into a photo's XMP packet: how the gimbal held the camera, and how sure the position is.

Source: XMP specification part 3 (packets in files); the makers' own namespaces are told apart by the names.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path

_SEARCHED = 1 << 18  # bytes from the file's beginning in which writers put the packet
_BEGIN, _END = b"<x:xmpmeta", b"</x:xmpmeta>"


def read_xmp(path: Path | str) -> Mapping[str, float]:
    """Numbers in a photo's XMP packet by name without namespace; empty where there is no (sound) packet.

    Raises OSError when the file cannot be opened.
    """
    with Path(path).open("rb") as file:
        data = file.read(_SEARCHED)
    begin = data.find(_BEGIN)
    end = data.find(_END, begin)
    return {} if begin < 0 or end < 0 else _numbers(data[begin : end + len(_END)])


def _numbers(packet: bytes) -> dict[str, float]:
    if b"<!" in packet:  # a packet has no declarations: entities could be made to fill the memory
        return {}
    try:
        root = ElementTree.fromstring(packet)
    except ElementTree.ParseError:
        return {}
    pairs = [(name, text) for element in root.iter() for name, text in element.attrib.items()]
    pairs += [(element.tag, element.text or "") for element in root.iter() if len(element) == 0]
    numbers = {}
    for name, text in pairs:
        try:
            value = float(text)
        except ValueError:
            continue
        if math.isfinite(value):
            numbers[name.rsplit("}", 1)[-1]] = value
    return numbers
