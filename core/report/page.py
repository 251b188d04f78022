"""The report's HTML page."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from html import escape

import numpy as np

from ..project.remarks import remarks_on
from ..project.stages.photo_pose import Method
from ..project.stages.residuals import tie_residuals
from .content import PhotoRow, Report
from .maps import FaceMap
from .style import STYLE

_NOTHING = "–"


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture of the page: its JPEG, its size in pixels, its title, and its legend when it is a map."""

    data: bytes
    width: int
    height: int
    title: str
    legend: FaceMap | None = None


def page(
    report: Report,
    rows: Sequence[PhotoRow],
    photos: Sequence[Figure],
    model: Sequence[Figure],
    maps: Sequence[Figure],
    layers: Mapping[str, Sequence[Figure]],
) -> str:
    """Return the whole page as text; pictures are inside it, those of further layers by their name."""
    sections = [
        _header(report, rows),
        _problems(report, rows),
        _photo_table(rows),
        _gallery("The model", "", [_figure(figure) for figure in model]),
        _gallery("Maps", "", [_figure(figure) for figure in maps]),
        *(_layer(report, name, figures) for name, figures in layers.items()),
        _gallery("Photos and their regions", _KEY, [_photo(f, r) for f, r in zip(photos, rows, strict=True)]),
        _method(report),
    ]
    title = escape(report.title)
    head = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title} – Fresco report</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
    )
    return head + "\n".join(section for section in sections if section) + "\n</main>\n</body>\n</html>\n"


def _layer(report: Report, name: str, figures: Sequence[Figure]) -> str:
    """Part of a further set of photos: how much it covers, its texture, its maps."""
    textured = report.layers[name]
    photos = ", ".join(escape(view.name) for view in textured.views)
    told = f'<p class="soft">{100 * textured.coverage:.1f} % of the surface, from {photos}.</p>'
    return _gallery(f"Layer “{escape(name)}”", told, [_figure(figure) for figure in figures])


_KEY = (
    '<p class="soft"><span class="key drawn"></span>region as marked in the photo'
    '<span class="key projected"></span>region of the scan, projected with the solved camera. '
    "Where the two lines lie on each other the camera stands right.</p>"
)


def _header(report: Report, rows: Sequence[PhotoRow]) -> str:
    scan, textured = report.scan, report.textured
    size = np.ptp(scan.vertices, axis=0) if len(scan.vertices) else np.zeros(3)
    placed = [row for row in rows if row.status in ("solved", "given")]
    facts = [
        ("Photos with a camera", f"{len(placed)} of {len(rows)}"),
        ("Overlap error, median", _number(_median(row.overlap_error for row in rows), "{:.2f} %")),
        ("Camera centre σ, median", _number(_median(row.centre_sigma for row in placed), "{:.1f} mm")),
        ("Rotation σ, median", _number(_median(row.rotation_sigma for row in placed), "{:.3f}°")),
        ("Surface with a photo", f"{100 * textured.coverage:.1f} %" if textured else _NOTHING),
        ("Photo pixel, median", _number(_median(row.texel_size for row in rows), "{:.2f} mm")),
        ("Faces of the scan", f"{len(scan.faces):,}".replace(",", " ")),
        ("Size of the scan", " × ".join(f"{length:.2f}" for length in size) + " m"),
    ]
    if report.truth:
        facts += [
            ("Rotation error, median", _number(_median(row.rotation_error for row in rows), "{:.3f}°")),
            ("Centre error, median", _number(_median(row.centre_error for row in rows), "{:.1f} mm")),
        ]
    items = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts)
    when = f"Written {escape(_when(report.written))}. " if report.written else ""
    offset = "Coordinates are as in the scan’s file."
    if np.any(scan.offset):
        numbers = ", ".join(f"{value:.3f}" for value in scan.offset)
        offset = f"Coordinates are kept relative to the offset ({numbers}) m."
    name = scan.path.name if scan.path else scan.name
    return (
        f"<header><h1>{escape(report.title)}</h1>"
        f'<p class="soft">{when}Scan {escape(name)}, metres. {offset}</p></header>'
        f'<dl class="facts">{items}</dl>'
    )


def _problems(report: Report, rows: Sequence[PhotoRow]) -> str:
    """What failed, why, and what to do; the sentences come from the stage that found it."""
    items = [_problem(row.name, row.status, row.failure) for row in rows if row.failure]
    warnings = [sentence for textured in report.textures for sentence in textured.selection.warnings]
    items += [f"<li>{escape(sentence)}</li>" for sentence in warnings]
    told = remarks_on([report.scan], report.photos, report.poses, report.surfaces)
    items += [f"<li>{escape(sentence)}</li>" for sentence in told]
    advice = "no face uses this photo: others see everything better, or it shows another part."
    unused = [row for row in rows if row.faces == 0 and not any(row.name in told for told in warnings)]
    items += [_problem(row.name, "unused", advice) for row in unused]
    if not items:
        return ""
    return f'<section><h2>To look at</h2><ul class="problems">{"".join(items)}</ul></section>'


def _problem(name: str, status: str, text: str) -> str:
    return (
        f'<li><strong>{escape(name)}</strong> <span class="{status}">({status})</span>: {escape(text)}</li>'
    )


_COLUMNS = (
    ("Photo", ""), ("Camera", ""), ("State", ""), ("Regions", ""),
    ("Overlap error", "%"), ("Edges", ""), ("To other photos", "px"),
    ("Ties", "px"), ("Rotation σ", "°"), ("Centre σ", "mm"),
    ("Surface σ", "mm"), ("Rotation error", "°"), ("Centre error", "mm"), ("Shift to others", "px"),
    ("Faces", ""), ("Area", "m²"), ("Pixel on surface", "mm"),
)  # fmt: skip


def _photo_table(rows: Sequence[PhotoRow]) -> str:
    """Numbers of all photos; columns that say nothing of any photo are left out."""
    table = [_cells(row) for row in rows]
    kept = [i for i in range(len(_COLUMNS)) if i < 4 or any(cells[i] != _NOTHING for cells in table)]
    head = "".join(
        f'<th scope="col"{_align(i)}>{name}{f"<br><span class=soft>{unit}</span>" if unit else ""}</th>'
        for i, (name, unit) in enumerate(_COLUMNS)
        if i in kept
    )
    body = "".join(
        f'<tr><th scope="row">{cells[0]}</th>'
        + "".join(f"<td{_align(i)}>{cells[i]}</td>" for i in kept[1:])
        + "</tr>"
        for cells in table
    )
    caption = (
        "Overlap error: the part of marked and projected regions that does not overlap. σ: one standard "
        "deviation, all axes together; surface σ: how far the photo may therefore lie off on the scan, "
        "median. Edges, to other photos: before → after refinement; edges agree by 1 where photo and scan "
        "have nothing in common. Ties: what the joint refinement left of them, median and what 95 % of them "
        "do not exceed. Shift: where a photo shows details against where others show them, median."
    )
    return (
        f'<section><h2>Photos</h2><div class="wide"><table><caption>{caption}</caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div></section>"
    )


def _cells(row: PhotoRow) -> list[str]:
    camera = "<br>".join(escape(text) for text in (row.body, row.camera) if text)
    return [
        escape(row.name),
        camera,
        f'<span class="{row.status}">{row.status}</span>',
        escape(", ".join(row.regions)) or _NOTHING,
        _number(row.overlap_error, "{:.2f}"),
        _change(row, "edges", "{:.2f}"),
        _change(row, "joint", "{:.1f}"),
        _ties(row),
        _number(row.rotation_sigma, "{:.3f}"),
        _number(row.centre_sigma, "{:.1f}"),
        _number(row.surface_shift, "{:.2f}"),
        _number(row.rotation_error, "{:.3f}"),
        _number(row.centre_error, "{:.1f}"),
        _number(row.shift, "{:.1f}"),
        _number(row.faces, "{:,}").replace(",", " "),
        _number(row.area, "{:.2f}"),
        _number(row.texel_size, "{:.2f}"),
    ]


def _change(row: PhotoRow, method: Method, form: str) -> str:
    """Score before and after the last refinement of a kind; one number where the pose was kept."""
    steps = [step for step in row.refinements if step.method == method]
    if not steps or not np.isfinite(steps[-1].score_before):
        return _NOTHING
    before = _number(steps[-1].score_before, form)
    return f"{before} → {_number(steps[-1].score_after, form)}" if steps[-1].moved else f"{before} (kept)"


def _ties(row: PhotoRow) -> str:
    """Median and 95 % quantile of the residuals of a photo's ties."""
    ties = tie_residuals(row.refinements)
    return _NOTHING if ties is None else f"{ties.length_at(0.5):.2f}, 95 %: {ties.length_at(0.95):.2f}"


def _align(column: int) -> str:
    if column == 1:
        return ' class="camera"'
    return ' class="number"' if column >= 4 else ""


def _gallery(title: str, introduction: str, figures: Sequence[str]) -> str:
    if not figures:
        return ""
    return f'<section><h2>{title}</h2>{introduction}<div class="gallery">{"".join(figures)}</div></section>'


def _figure(figure: Figure, caption: str = "", alternative: str = "") -> str:
    data = base64.b64encode(figure.data).decode("ascii")
    text = f"<strong>{escape(figure.title)}</strong>{caption or _legend(figure.legend)}"
    return (
        f'<figure><img src="data:image/jpeg;base64,{data}" width="{figure.width}" height="{figure.height}" '
        f'alt="{escape(alternative or figure.title)}"><figcaption>{text}</figcaption></figure>'
    )


def _photo(figure: Figure, row: PhotoRow) -> str:
    parts = [row.status]
    if row.overlap_error is not None:
        parts.append(f"overlap error {row.overlap_error:.2f} %")
    if row.rotation_sigma is not None and row.centre_sigma is not None:
        parts.append(f"σ {row.rotation_sigma:.3f}° and {row.centre_sigma:.1f} mm")
    caption = f": {escape(', '.join(parts))}."
    kept = [step.note for step in row.refinements if step.note]
    caption += "".join(f" {escape(note)}" for note in (*row.notes, *kept))
    regions = ", ".join(row.regions) or "none"
    return _figure(figure, caption, f"Photo {row.name} with the outlines of its regions: {regions}")


def _legend(legend: FaceMap | None) -> str:
    if legend is None:
        return ""
    ramp = ""
    if legend.scale is not None:
        stops = ", ".join(_css(legend.scale[i]) for i in np.linspace(0, len(legend.scale) - 1, 9).astype(int))
        ramp = (
            f"<br>{escape(legend.ends[0])}"
            f'<span class="ramp" style="background: linear-gradient(to right, {stops})"></span>'
            f"{escape(legend.ends[1])}"
        )
    swatches = "".join(
        f'<span class="entry"><span class="swatch" style="background: {_css(colour)}"></span>'
        f"{escape(text)}</span> "
        for colour, text in legend.entries
    )
    return f"{ramp}<br>{swatches}"


def _css(colour: Iterable[int]) -> str:
    return "#" + "".join(f"{int(part):02x}" for part in colour)


def _method(report: Report) -> str:
    times = ", ".join(f"{escape(name)} {value:.1f} s" for name, value in report.seconds.items())
    timed = f"<p>Time: {times}.</p>" if times else ""
    timed = "".join(f"<p>{escape(sentence)}</p>" for sentence in report.made) + timed
    versions = ", ".join(f"{escape(name)} {escape(value)}" for name, value in report.versions.items())
    return (
        f"<section><h2>How it was made</h2>{timed}"
        f'<p class="soft">{versions or "Fresco"}. The photos were not changed: the texture refers to their '
        "original pixels.</p></section>"
    )


def _when(written: str) -> str:
    """ISO time without seconds, as people write it; any other text as it is."""
    try:
        time = datetime.fromisoformat(written)
    except ValueError:
        return written
    return f"{time:%Y-%m-%d %H:%M} {time.tzname() or ''}".strip()


def _number(value: float | None, form: str) -> str:
    return _NOTHING if value is None or not np.isfinite(value) else form.format(value)


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None and np.isfinite(value)]
    return float(np.median(known)) if known else None
