"""Write docs/settings.md: every setting with its unit, default and meaning, as the dataclasses explain it.

`settings_page.py` writes the page; a test holds that it is current.
"""

from __future__ import annotations

import dataclasses
import json
import re
import typing
from pathlib import Path
from typing import Any

from fresco.core.project.stages.delivery import DeliverySettings
from fresco.core.project.stages.refinement import RefineSettings
from fresco.core.project.stages.simplified import SimplifySettings
from fresco.core.settings import (
    AlignSettings,
    AtlasSettings,
    EdgeSettings,
    JointSettings,
    PointSettings,
    PoseSettings,
    RegionSettings,
    ScanSettings,
    TextureSettings,
    field_texts,
)

PAGE = Path(__file__).resolve().parents[1] / "docs" / "settings.md"
INTRODUCTION = """\
# Settings

Every number that a stage can be told, with its default. They stand in the tables of
[the project file](project-file.md), which also names what is no setting: files, photos, cameras, outputs.
In the window they are in the sub-panels *Settings* of each step, with these texts as tooltips. A dash as
default means that the program chooses, or that the step is left out.

This page is written by `tools/settings_page.py` from the code.
"""
SECTIONS: tuple[tuple[str, tuple[type, ...]], ...] = (
    ("`[scan]`", (ScanSettings,)),
    ("`[pose]`", (PoseSettings,)),
    ("`[points]`", (PointSettings,)),
    ("`[refine]`", (RefineSettings,)),
    ("`[refine]` `edges = { … }`", (EdgeSettings,)),
    ("`[refine]` `joint = { … }`", (JointSettings,)),
    ("`[texture]`", (TextureSettings,)),
    ("`[atlas]`", (AtlasSettings, DeliverySettings)),
    ("`[simplify]`", (SimplifySettings,)),
    ("Wands that mark regions: in the code only", (RegionSettings,)),
    ("Aligning scans: in the code only", (AlignSettings,)),
)
KEYS = {"tolerance": ("tolerance_mm", "mm")}
"""Names and units in the project file that differ from the dataclass's."""
_UNIT = re.compile(r"\s*\((m|mm|degrees|%|pixels|GiB|share|Delta E|grey levels²|m per m)(?!\w)([^()]*)\)")


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Return the page as it should be."""
    parts = [INTRODUCTION]
    for title, kinds in SECTIONS:
        purpose = " ".join((kinds[0].__doc__ or "").split("\n\n")[0].split())
        rows = [row for kind in kinds for row in _rows(kind)]
        table = "\n".join(["| key | unit | default | meaning |", "| --- | --- | --- | --- |", *rows])
        parts.append(f"## {title}\n\n{purpose}\n\n{table}\n")
    return "\n".join(parts)


def _rows(kind: type) -> list[str]:
    texts, hints = field_texts(kind), typing.get_type_hints(kind)
    return [
        _row(field, hints[field.name], texts[field.name])
        for field in dataclasses.fields(kind)
        if not dataclasses.is_dataclass(hints[field.name])  # has a section of its own
    ]


def _row(field: dataclasses.Field[Any], hint: Any, text: str) -> str:
    flat = " ".join(text.split()).replace("|", "\\|")
    found = _UNIT.search(flat)
    unit = f"{found[1]}{found[2]}" if found else ""
    meaning = flat if found is None else flat[: found.start()] + flat[found.end() :]
    name, unit = KEYS.get(field.name, (field.name, unit))
    return f"| `{name}` | {unit} | {_default(field.default)} | {meaning}{_choices(hint)} |"


def _default(value: Any) -> str:
    """How the project file writes a default."""
    return "–" if value is None else f"`{json.dumps(value)}`"


def _choices(hint: Any) -> str:
    if typing.get_origin(hint) is not typing.Literal:
        return ""
    return f" One of {', '.join(f'`{json.dumps(word)}`' for word in typing.get_args(hint))}."


if __name__ == "__main__":
    main()
