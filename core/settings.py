"""One frozen dataclass per stage; every threshold is explained where it stands."""

from __future__ import annotations

import ast
import inspect
import itertools
import sys
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class ScanSettings:
    """Reading and checking a scan."""

    weld_distance: float = 0.0
    """Vertices closer than this (m) become one; 0 joins only identical ones."""

    unit: float = 1.0
    """Metres per unit of the file: 0.001 for millimetres, 0.3048 for feet."""

    up: Literal["auto", "y", "z"] = "auto"
    """Axis of the file that points up, "z" or "y"; "auto" is y for glTF, whose definition says so, else z."""

    offset: tuple[float, float, float] | None = None
    """Metres taken off the coordinates (world = local + offset); without it they are chosen."""

    epsg: int | None = None
    """EPSG code of the UTM zone that the coordinates are in, such as 25832, for photos that tell where they
    were taken; without it solved photos show how satellite positions lie in the scan."""

    offset_limit: float = 10_000.0
    """An axis with larger coordinates (m) gets an offset: single precision keeps 1 mm up to about 16 km."""

    turn_over: bool = False
    """Turn all faces over, for a scan whose faces look away from where it was scanned."""


@dataclass(frozen=True)
class RegionSettings:
    """Marking regions in photos and on the scan."""

    working_size: int = 1536
    """Longer side (pixels) of the copy that the photo wand searches; outlines are finished on the photo."""

    least_support: float = 0.3
    """Share of a frame's side that an edge of the photo has to cover; one of the four may have less."""

    line_limit: int = 100
    """Straight edges around a click that may be the long sides of a frame."""

    level_count: int = 40
    """Frames of different size that dragging can choose from."""

    snap_reach: float = 3.0
    """How far (pixels of the working copy) an outline is moved to meet an edge at full resolution."""

    seed_patches: int = 50
    """Small patches around a click on the scan that make the first plane."""

    surface_levels: int = 12
    """Tolerances that a click on the scan tries, from the scan's noise up, each 1.4 times the one before."""

    surface_frames: int = 12
    """Frames of straight creases around a click on the scan that dragging can choose from."""

    tilt: float = 0.15
    """How far (m per m) the surface may leave the first plane: that one is uncertain far from the click."""

    crease_angle: float = 50.0
    """Angle (degrees) to the fitted surface at which a face no longer belongs to it."""

    colour_tolerance: float = 12.0
    """Colour difference (Delta E) at which the surface wand stops, on a scan with colours; 0 ignores them."""


@dataclass(frozen=True)
class AlignSettings:
    """Aligning scans by their surfaces."""

    reach: float = 0.3
    """Largest distance (m) between the scans at the start; pairs farther apart do not count."""

    least_reach: float = 0.01
    """Distance (m) below which the reach does not shrink, whatever the noise."""

    iterations: int = 60
    """Largest number of rounds."""

    source_points: int = 50_000
    """Points of the moving scan that are compared."""

    target_points: int = 1_000_000
    """Points of the fixed scan that they are compared with."""


@dataclass(frozen=True)
class PoseSettings:
    """Camera poses from regions."""

    overlap_limit: float = 20.0
    """Largest overlap error (%) at which a pose counts as found. Roughly drawn regions overlap by no better
    than their own drawing error; a wrong pose leaves more."""


@dataclass(frozen=True)
class TextureSettings:
    """Choice of the photo for every face."""

    max_angle: float = 85.0
    """Largest angle (degrees) between viewing ray and face normal at which a photo is used."""

    double_sided: bool = False
    """Faces may be seen from behind: for scans whose triangles do not all face outwards."""

    uv_tolerance: float = 0.5
    """Largest distance (pixels) between straight UV edges and the true projection of a face's edges."""

    visible_share: float = 0.7
    """Smallest share of a face's tested points that must be unhidden; faces seen whole are preferred."""

    occlusion_tolerance: float = 0.0
    """Surfaces nearer than this (m) in front of a face do not hide it: for scans of several noisy layers."""

    score: Literal["texel", "published"] = "texel"
    """What makes a photo good for a face: its texel size on the surface, or eq. 3.39 as published."""

    hidden_penalty: float = 8.0
    """Octaves of texel size, times the square root of the hidden share, that a partly hidden face costs."""

    clipped_penalty: float = 3.0
    """Octaves of texel size that a wholly burnt-out face costs."""

    clipped_level: int = 252
    """Channel value (of 255) from which a pixel counts as burnt out."""

    max_candidates: int = 10
    """Photos remembered per face; bounds the memory (about 20 bytes per face and photo)."""

    equalise: bool = True
    """Find one gain per photo and channel from what the photos see in common."""

    gain_anchor: int | None = None
    """Photo whose colours stay as they are, counted from 0 in the order of the photos; without one, and where
    that photo takes no part, the median of the gains is 1."""

    smoothness: float = 22.0
    """Length, in texels of the finest photos, at which a seam costs as much as one octave of resolution over
    its square; larger: fewer, larger patches; 0: every face takes its own best photo."""

    sharpness: Literal["compared", "published", "off"] = "compared"
    """Measure the photos' blur by comparing them on the same surface, or leave out what lies beyond the depth
    of field that wavelet windows find in each photo alone."""

    check_poses: bool = True
    """Leave out photos whose contents lie elsewhere than in their neighbours."""

    reject_foreign: bool = True
    """Leave out the parts of photos that show what other photos do not: people, vehicles, glare."""

    analysed_pixels: float = 6.5e6
    """Larger photos are halved until they have at most so many pixels before they are compared."""

    threads: int = 0
    """Photos looked at together; each takes up to about 150 MB for a moment. 0: one per core, at most 8."""

    focus_threshold: float = 1.1
    """Variance of wavelet detail (grey levels²) from which a window counts as in focus, as published."""

    focus_blur: float = 1.0
    """Largest blur (sigma, pixels) by aperture and focus distance that the published way accepts."""

    memory_limit: float = 0.0
    """Memory (GiB) that choosing photos may take: fewer photos are looked at together, then fewer remembered
    per face, at least 3; a scan that is too large even so is refused. 0: as much as is useful."""


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


@dataclass(frozen=True)
class JointSettings:
    """All camera poses together, tied by features that lie on the scan."""

    photo_size: int = 2400
    """Longer side (pixels) at which features are looked for; larger photos are reduced to it."""

    features: int = 6000
    """Features kept per photo, spread over it."""

    first_features: int = 2500
    """Of these, the strongest ones that tie the photos while their poses are still rough."""

    partners: int = 10
    """Photos that each photo is matched with: those that see most of the same surface."""

    max_parallax: float = 50.0
    """Largest angle (degrees) between the lines of sight of two photos that are matched."""

    rotation_sigma: float = 0.3
    """Standard deviation (degrees, per axis) of a starting pose that comes without covariance."""

    centre_sigma: float = 0.03
    """Standard deviation (m, per axis) of a starting camera centre that comes without covariance."""

    scan_sigma: float = 0.005
    """Standard deviation (m) of the scan's surface to start with; the ties then tell the true one."""

    patch: float = 1.5
    """Size (m) of a patch of scan whose errors are alike: more ties on it do not average them out."""

    min_ties: int = 20
    """Ties that a photo needs to be moved at all."""

    focal_sigma: float = 0.01
    """Standard deviation of a given focal length, as a share of it, where lenses are adjusted."""

    principal_point_sigma: float = 0.005
    """Standard deviation (share of the longer side) of a given principal point, where lenses are adjusted."""

    radial_sigma: float = 0.05
    """Standard deviation of given radial distortion coefficients k1 and k2, where lenses are adjusted."""

    lens_limit: float = 2.0
    """Largest standard deviation (pixels, at the photo's border) of an adjusted lens; else it is kept."""

    seed: int = 0
    """Start of the random numbers: the same photos give the same poses."""


@dataclass(frozen=True)
class AtlasSettings:
    """Baking an atlas for delivery."""

    texel_size: float = 0.0
    """Side of a texel on the surface (m). 0 copies the photos pixel by pixel, whatever their size; charts
    that follow the surface take the median then."""

    charts: Literal["photos", "surface"] = "photos"
    """Charts as the photos show the faces, which keeps most detail, or flattened from the surface alone
    (xatlas), for models that are repainted elsewhere: unseen faces get room as well."""

    page_size: int = 4096
    """Side of a page (pixels); there are as many pages (UDIM tiles) as are needed."""

    padding: int = 4
    """Width (pixels) of the rim around each chart that is filled with its colours, so that smaller mip levels
    stay clean."""

    depth: Literal[8, 16] = 8
    """Bits per channel."""

    blend_rings: int = 4
    """Rings of faces over which the lowest frequencies cross-fade at seams; every octave above takes half as
    many, fine detail one. 0: none."""


@dataclass(frozen=True)
class EdgeSettings:
    """One camera pose by the edges of the scan."""

    photo_size: int = 1600
    """Longer side (pixels) of the finer of the two sizes at which edges are aligned, one half the other."""

    search: float = 8.0
    """Distance (pixels of a level) along its normal in which an edge of the scan looks for the photo's."""

    crease: float = 8.0
    """Smallest turn (degrees per pixel of a level) of the surface that counts as an edge."""

    step: float = 3.0
    """Smallest depth step that counts as an edge, in pixels of a level on the nearer surface."""

    max_edges: int = 8000
    """Edge points used per level, spread over the photo."""

    min_edges: int = 80
    """Edge points that a photo needs to be moved at all."""

    min_share: float = 0.5
    """Smallest share of the scan's visible edges that must have a partner in the photo."""

    rotation_sigma: float = 1.0
    """Standard deviation (degrees, per axis) of a starting pose that comes without covariance."""

    centre_sigma: float = 0.1
    """Standard deviation (m, per axis) of a starting camera centre that comes without covariance."""

    min_score: float = 1.1
    """Smallest edge agreement (1: none) at which a pose is believed."""

    seed: int = 0
    """Start of the random numbers: the same photo gives the same pose."""


def field_texts(dataclass: type) -> dict[str, str]:
    """Text under each field of a dataclass, here or in another module."""
    tree = ast.parse(inspect.getsource(sys.modules[dataclass.__module__]))
    classes = {node.name: node.body for node in tree.body if isinstance(node, ast.ClassDef)}
    texts = {}
    for field, text in itertools.pairwise(classes[dataclass.__name__]):
        if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
            continue
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
            texts[field.target.id] = inspect.cleandoc(str(text.value.value))
    return texts
