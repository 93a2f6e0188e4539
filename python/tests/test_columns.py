"""Compares columns of SPH particles with sums in numpy: true kernels, means over pixels, periodic boxes."""

import numpy as np
import pytest

import ewa_splat as es

SIDE = 40
"""Pixels along a side; the picture shows the box from 0 to 1."""
FINE = 24
"""Points along a side of a pixel."""


def cubic(u):
    """Return the cubic spline of support 1, whose integral over space is 1."""
    q = 2 * np.asarray(u)
    inner = 1 - 1.5 * q**2 + 0.75 * q**3
    outer = 0.25 * np.maximum(2 - q, 0) ** 3
    return np.where(q < 1, inner, outer) * 8 / np.pi


def wendland_c4(u):
    """Return Wendland's C4 of support 1, whose integral over space is 1."""
    u = np.minimum(u, 1)
    return 495 / (32 * np.pi) * (1 - u) ** 6 * (1 + 6 * u + 35 / 3 * u**2)


def projection(kernel):
    """Return the line integral of a kernel as a function of the impact parameter."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    b = np.linspace(0, 1, 2001)
    half = np.sqrt(1 - b**2)
    radii = np.hypot(b[:, None], half[:, None] * nodes)
    values = (kernel(np.minimum(radii, 1)) * weights).sum(1) * half
    return lambda r: np.interp(r, b, values, right=0)


def means(kernel, positions, supports, masses, period=None):
    """Sum kernels at many points of each pixel."""
    along = (np.arange(SIDE * FINE) + 0.5) / (SIDE * FINE)
    project = projection(kernel)
    sums = np.zeros((SIDE * FINE, SIDE * FINE))
    shifts = (0,) if period is None else (-period, 0, period)
    for (x, y, _), support, mass in zip(positions, supports, masses, strict=True):
        for dx in shifts:
            for dy in shifts:
                r = np.hypot(along - x - dx, (along - y - dy)[:, None])
                if r.min() < support:
                    sums += mass / support**2 * project(r / support)
    own = sums.reshape(SIDE, FINE, SIDE, FINE).mean((1, 3))
    return own[::-1]


def particles(count=12, seed=5):
    random = np.random.default_rng(seed)
    return random.uniform(0.2, 0.8, (count, 3)), random.uniform(0.1, 0.19, count), random.uniform(0.5, 2, count)


def column_of(thing, camera=None):
    return es.Renderer(thing, backend="cpu").column_density(camera, size=(SIDE, SIDE))


@pytest.mark.parametrize(("name", "kernel"), [("cubic", cubic), ("wendland-c4", wendland_c4)])
def test_columns_are_those_of_the_kernels(name, kernel):
    positions, supports, masses = particles()
    # Everything has support h in some codes and 2 h in others: both say the same here.
    for lengths, length in ((supports, "support"), (supports / 2, "h")):
        thing = es.Volume.from_points(positions, mass=masses, smoothing_length=lengths, kernel=name, length=length)
        camera = es.Camera.along("z", centre=(0.5, 0.5, 0.5), width=1)
        own = column_of(thing, camera)
        truth = means(kernel, positions, supports, masses)
        # Midpoints err by 1e-4 themselves.
        assert np.abs(own.values - truth).max() < 3e-4 * truth.max()
        assert own.values.sum() * own.pixel_area == pytest.approx(masses.sum(), rel=2e-5)


def test_gaussians_remain_on_request():
    positions, supports, masses = particles()
    camera = es.Camera.along("z", centre=(0.5, 0.5, 0.5), width=1)
    of = {}
    for kernel in ("cubic", "gaussian"):
        thing = es.Volume.from_points(positions, mass=masses, smoothing_length=supports / 2, kernel=kernel)
        of[kernel] = column_of(thing, camera).values
    sigma = supports[0] / 2 * np.sqrt(0.3)
    alone = es.Volume.from_points(positions[:1], mass=masses[:1], smoothing_length=supports[:1] / 2, kernel="gaussian")
    peak = masses[0] / (2 * np.pi * sigma**2)
    assert column_of(alone, camera).values.max() == pytest.approx(peak, rel=0.05)
    assert np.abs(of["cubic"] - of["gaussian"]).max() > 0.02 * of["cubic"].max()


def test_periodic_boxes_wrap_kernels():
    positions, supports, masses = particles(seed=8)
    positions = (positions + 0.45) % 1
    thing = es.Volume.from_points(positions, mass=masses, smoothing_length=supports / 2, box=1)
    own = column_of(thing)
    assert np.allclose(own.extent, (0, 1, 0, 1))
    truth = means(cubic, positions, supports, masses, period=1)
    # Kernels that a face of the box cuts in depth keep a share of a Gaussian there, and their images the rest.
    assert np.abs(own.values - truth).max() < 2e-3 * truth.max()
    assert own.values.sum() * own.pixel_area == pytest.approx(masses.sum(), rel=1e-4)
    moved = es.Volume.from_points(
        positions, mass=masses, smoothing_length=supports / 2, box=(1, 1, 1), centre=(0.75, 0.5, 0.5)
    )
    shifted = column_of(moved)
    assert np.allclose(shifted.extent, (0.25, 1.25, 0, 1))
    assert np.abs(np.roll(own.values, -SIDE // 4, 1) - shifted.values).max() < 1e-3 * truth.max()
    bare = es.Volume.from_points(positions, mass=masses, smoothing_length=supports / 2)
    with pytest.raises(ValueError, match="the same periodic box"):
        es.Renderer(thing, bare, backend="cpu").column_density(size=(8, 8))
    with pytest.raises(ValueError, match="expected a box"):
        es.Volume.from_points(positions, mass=masses, smoothing_length=supports, centre=(0, 0, 0))


def splat_sizes(thing, path, width):
    """Return the median of the splats' first standard deviations."""
    es.convert(thing, path, width=width)
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    names = [line.split()[2] for line in data[:end].decode().splitlines() if line.startswith("property float")]
    table = np.frombuffer(data, "<f4", offset=end).reshape(-1, len(names))
    return np.exp(np.median(table[:, names.index("scale_0")]))


def test_light_is_baked_into_splats(tmp_path):
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    mesh = es.Surfels.from_mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    sizes = {}
    for light in ({}, {"lit": True}, {"lights": [(0, 0, 1)]}):
        written = es.convert(mesh, tmp_path / "a.ply", **light)
        assert written["splats"] > 0
        sizes[str(light)] = written["bytes"] / written["splats"]
    # Harmonics of degree 2: 24 more numbers a splat.
    assert all(sizes[key] > sizes["{}"] + 90 for key in list(sizes)[1:])
    sigmas = [splat_sizes(mesh, tmp_path / "b.ply", width) for width in (None, 0.4)]
    assert sigmas[1] == pytest.approx(0.4 / 0.55 * sigmas[0], rel=0.05)
    for wrong in ({"width": 0}, {"lit": False, "lights": [(0, 0, 1)]}):
        with pytest.raises(ValueError):
            es.convert(mesh, tmp_path / "c.ply", **wrong)
    bare = es.Volume.from_points(corners, mass=np.ones(4), color=(1, 1, 1), radius=0.1)
    with pytest.raises(ValueError, match="lit"):
        es.convert(bare, tmp_path / "c.ply", lit=True)
