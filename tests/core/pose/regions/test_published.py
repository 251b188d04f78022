import numpy as np
from fresco.core.cameras import FisheyeCamera, PerspectiveCamera
from fresco.core.geometry.charts import chart_around
from fresco.core.geometry.moments import edge_moments, exponents
from fresco.core.geometry.rigid import exp_so3, rotation_angle
from fresco.core.pose import estimate_pose
from fresco.core.pose.regions.algebraic import Candidates, refine_by_moments
from fresco.core.pose.regions.problem import loop_edges, make_problem
from fresco.core.regions import ImageRegion
from published import (
    pixel_integrals,
    plane_moments,
    solid_angles,
    solve_plane,
    solve_sphere,
    sphere_integrals,
)
from region_scenes import ELL, SHAPES, Scene

CAMERA = PerspectiveCamera(1200, 800, [[800, 0, 599.5], [0, 800, 399.5], [0, 0, 1]])
FISHEYE = FisheyeCamera(1200, 800, [[500, 0, 599.5], [0, 500, 399.5], [0, 0, 1]], [0.02, -0.01])
THREE = ["ell", "prow", "gable"]


def patches_of(scene):
    return [(surface.vertices, surface.faces) for surface in scene.surfaces]


def exact_regions(camera, scene):
    """Polygons of the true projections, with short edges where the lens bends them."""
    polygons = []
    for surface in scene.surfaces:
        (loop,) = surface.loops
        ends = np.roll(loop, -1, axis=0)
        fine = (
            loop[:, None] + np.linspace(0, 1, 60, endpoint=False)[:, None] * (ends - loop)[:, None]
        ).reshape(-1, 3)
        polygons.append(camera.project(fine @ scene.rotation.T + scene.translation))
    return [
        ImageRegion.from_polygon(polygon, name=n) for polygon, n in zip(polygons, scene.names, strict=True)
    ]


def test_boundary_integrals_are_the_published_sums_over_triangles():
    outline, faces = np.array(ELL, dtype=float), SHAPES["ell"][1]
    p, q = exponents(4)
    powers = list(zip(p.tolist(), q.tolist(), strict=True))
    found = edge_moments(*loop_edges([outline]), 4)
    np.testing.assert_allclose(found, plane_moments(outline, faces, powers), rtol=1e-12)


def test_equal_area_chart_keeps_solid_angles():
    fine = np.array([[x, y, 1.0] for x, y in np.array(ELL) * 1.5 - 0.7])
    ends = np.roll(fine, -1, axis=0)
    dense = (
        fine[:, None] + np.linspace(0, 1, 400, endpoint=False)[:, None] * (ends - fine)[:, None]
    ).reshape(-1, 3)
    rays = dense / np.linalg.norm(dense, axis=1, keepdims=True)
    around = np.array([[np.cos(a) * 0.95, np.sin(a) * 0.95, 0.3] for a in np.linspace(0, 6.2, 40)])
    chart = chart_around(np.concatenate([rays, around / np.linalg.norm(around, axis=1, keepdims=True)]))
    assert chart.equal_area
    area = abs(edge_moments(*loop_edges([chart.flatten(rays)]), 0)[0]) / chart.scale**2
    corners = fine / np.linalg.norm(fine, axis=1, keepdims=True)
    expected = np.abs(solid_angles(corners[np.array(SHAPES["ell"][1])])).sum()
    np.testing.assert_allclose(area, expected, rtol=1e-5)


def test_pixel_sums_approach_the_integrals_over_spherical_triangles():
    scene = Scene(FISHEYE, ["prow"])
    points = scene.surfaces[0].vertices @ scene.rotation.T + scene.translation
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    expected = sphere_integrals(rays, scene.surfaces[0].faces)
    np.testing.assert_allclose(pixel_integrals(FISHEYE, scene.masks[0]), expected, rtol=5e-3)


def test_published_plane_solver_has_the_same_minimum():
    scene = Scene(CAMERA, THREE)
    regions = exact_regions(CAMERA, scene)
    observed = []
    for surface in scene.surfaces:
        points = surface.vertices @ scene.rotation.T + scene.translation
        observed.append(plane_moments(points[:, :2] / points[:, 2:], surface.faces))
    start = exp_so3([0.02, -0.03, 0.01]) @ scene.rotation, scene.translation + np.array([0.02, -0.01, 0.05])
    rotation, translation = solve_plane(observed, patches_of(scene), *start)
    assert np.degrees(rotation_angle(rotation @ scene.rotation.T)) < 1e-4
    problem = make_problem(CAMERA, regions, scene.surfaces, paired=True)
    shifted = translation + rotation @ problem.origin
    ours = refine_by_moments(problem.moments, Candidates(rotation[None], shifted[None], np.zeros(1)), 20)
    assert np.degrees(rotation_angle(ours.rotations[0] @ rotation.T)) < 1e-3
    np.testing.assert_allclose(ours.translations[0], shifted, atol=1e-4)
    pose = estimate_pose(CAMERA, regions, scene.surfaces)
    assert np.degrees(rotation_angle(pose.rotation @ rotation.T)) < 0.01


def test_published_sphere_solver_has_the_same_minimum():
    scene = Scene(FISHEYE, THREE)
    regions = exact_regions(FISHEYE, scene)
    observed = []
    for surface in scene.surfaces:
        points = surface.vertices @ scene.rotation.T + scene.translation
        rays = points / np.linalg.norm(points, axis=1, keepdims=True)
        observed.append(sphere_integrals(rays, surface.faces))
    start = exp_so3([0.02, -0.03, 0.01]) @ scene.rotation, scene.translation + np.array([0.02, -0.01, 0.05])
    rotation, translation = solve_sphere(observed, patches_of(scene), *start)
    assert np.degrees(rotation_angle(rotation @ scene.rotation.T)) < 1e-3
    pose = estimate_pose(FISHEYE, regions, scene.surfaces)
    assert np.degrees(rotation_angle(pose.rotation @ rotation.T)) < 0.01
    np.testing.assert_allclose(pose.centre, -rotation.T @ translation, atol=2e-3)
