"""One frozen dataclass per stage; every threshold is explained where it stands."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ScanSettings:
    """Reading and checking a scan."""

    weld_distance: float = 0.0
    """Vertices closer than this (m) become one; 0 joins only identical ones."""


@dataclass(frozen=True)
class PoseSettings:
    """Camera poses from regions."""

    overlap_limit: float = 5.0
    """Largest overlap error (%) at which a pose counts as found (published criterion: 5 %)."""


@dataclass(frozen=True)
class TextureSettings:
    """Choice of the photo for every face."""

    max_angle: float = 85.0
    """Largest angle (degrees) between viewing ray and face normal at which a photo is used."""

    uv_tolerance: float = 0.5
    """Largest distance (pixels) between straight UV edges and the true projection of a face's edges."""


@dataclass(frozen=True)
class PointSettings:
    """Camera poses from points with known coordinates."""

    threshold: float = 8.0
    """Largest distance (pixels) between a picked pixel and its point while the pose is searched for."""

    sigma: float = 1.0
    """Expected standard deviation (pixels) of a picked pixel; few points cannot tell it themselves."""

    confidence: float = 0.9999
    """Probability that the search has drawn three good points before it stops."""

    max_samples: int = 20000
    """Largest number of triples drawn."""

    max_rotation_sigma: float = 3.0
    """Largest standard deviation (degrees) of the rotation at which a pose counts as determined."""

    seed: int = 0
    """Start of the random numbers: the same points give the same pose."""
