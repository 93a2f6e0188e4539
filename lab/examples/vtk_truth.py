#!/usr/bin/env python3
"""VTK's volume renderers on the grids of `lab/examples/truth`, against the same true pictures.

    cargo run --release -p ewa-splat-lab --example truth -- --export out/truth "extent .15"
    pip install vtk numpy
    python3 lab/examples/vtk_truth.py out/truth [GRID|FUNCTION|MAPPER ...] [--pictures]

Prints rows like those of the example: RMSE and 99.9th percentile in levels of 255, linear colour, and
milliseconds of a frame. Pictures are read back from a window of 8 bits a channel, which costs .3 RMSE.
`-plain` hands mappers of cells the opacities as they are; without it the rates of extinction that they
mean, which is nearer to the truth for projected tetrahedra and not always for the others. VTK has no pixel
filter: one ray through each pixel's centre, or 16 (`-x16`: a picture four times as wide and
high, averaged).
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import vtk
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy

FRAMES = 2


def with_values(grid, values):
    array = numpy_to_vtk(values, deep=True)
    array.SetName("field")
    grid.GetPointData().SetScalars(array)
    return grid


def points_of(nodes):
    points = vtk.vtkPoints()
    points.SetDataTypeToDouble()
    points.SetData(numpy_to_vtk(nodes, deep=True))
    return points


def load(folder, name):
    values = np.fromfile(folder / f"{name}.values", "<f4")
    n = int(name.split("-")[1])
    if name.startswith("lattice"):
        grid = vtk.vtkImageData()
        grid.SetDimensions(n, n, n)
        grid.SetOrigin(-1, -1, -1)
        grid.SetSpacing(*[2 / (n - 1)] * 3)
        return with_values(grid, values)
    nodes = np.fromfile(folder / f"{name}.nodes", "<f8").reshape(-1, 3)
    if name.startswith("warp"):
        grid = vtk.vtkStructuredGrid()
        grid.SetDimensions(n, n, n)
        grid.SetPoints(points_of(nodes))
        return with_values(grid, values)
    corners = np.fromfile(folder / f"{name}.cells", "<u4").reshape(-1, 4).astype(np.int64)
    cells = vtk.vtkCellArray()
    offsets = np.arange(0, 4 * len(corners) + 1, 4, dtype=np.int64)
    cells.SetData(
        numpy_to_vtkIdTypeArray(offsets, deep=True),
        numpy_to_vtkIdTypeArray(corners.ravel(), deep=True),
    )
    grid = vtk.vtkUnstructuredGrid()
    grid.SetPoints(points_of(nodes))
    grid.SetCells(vtk.VTK_TETRA, cells)
    return with_values(grid, values)


def resampled(grid, n):
    """On n³ places of the box; its outermost ones may lie just outside of the cells."""
    resample = vtk.vtkResampleToImage()
    resample.SetInputDataObject(grid)
    resample.SetSamplingDimensions(n, n, n)
    resample.UseInputBoundsOff()
    resample.SetSamplingBounds(-1, 1, -1, 1, -1, 1)
    resample.Update()
    image = resample.GetOutput()
    mask = vtk_to_numpy(image.GetPointData().GetArray("vtkValidPointMask"))
    field = vtk_to_numpy(image.GetPointData().GetArray("field"))
    plain = vtk.vtkImageData()
    plain.CopyStructure(image)
    plain.GetPointData().Initialize()
    return with_values(plain, field.copy()), int((mask == 0).sum())


def ray_caster(step):
    def make(grid):
        mapper = vtk.vtkFixedPointVolumeRayCastMapper()
        mapper.SetInputData(grid)
        mapper.AutoAdjustSampleDistancesOff()
        mapper.SetImageSampleDistance(1)
        mapper.SetSampleDistance(step * grid.GetSpacing()[0])
        return mapper

    return make


def of_cells(kind):
    def make(grid):
        mapper = kind()
        mapper.SetInputData(grid)
        if hasattr(mapper, "SetImageSampleDistance"):
            mapper.AutoAdjustSampleDistancesOff()
            mapper.SetImageSampleDistance(1)
        return mapper

    return make


def tables(points, unit, as_rates):
    """A property of the points. `as_rates`: opacities stand for rates of extinction, in a unit that keeps them
    below 1, as mappers of cells take them."""
    colour, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    colour.SetColorSpaceToRGB()
    values, opacities = [], []
    for point in points:
        # VTK merges two points at the same value.
        values.append(point["value"] + (1e-6 if point["value"] in values else 0))
        opacities.append(point["opacity"])
        colour.AddRGBPoint(values[-1], *point["color"])
    if as_rates:
        # Opacities are linear between points; rates of extinction are not.
        fine = np.unique(np.concatenate([values, np.linspace(values[0], values[-1], 2000)]))
        rates = -np.log1p(-np.interp(fine, values, opacities))
        values, opacities = fine, rates / rates.max()
        unit /= rates.max()
    for value, at in zip(values, opacities):
        opacity.AddPoint(value, at)
    look = vtk.vtkVolumeProperty()
    look.SetColor(colour)
    look.SetScalarOpacity(opacity)
    look.SetScalarOpacityUnitDistance(unit)
    look.SetInterpolationTypeToLinear()
    look.ShadeOff()
    return look


def draw(scene, mapper, look, rays=1):
    volume = vtk.vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(look)
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(0, 0, 0)
    renderer.AddVolume(volume)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*scene["eye"])
    camera.SetFocalPoint(0, 0, 0)
    camera.SetViewUp(0, 0, 1)
    camera.SetViewAngle(scene["vertical_fov_deg"])
    renderer.ResetCameraClippingRange()
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    size = scene["size"]
    window.SetSize(rays * size, rays * size)
    window.AddRenderer(renderer)
    times = []
    for _ in range(FRAMES + 1):
        # Marks the camera as moved each time; otherwise tetrahedra keep their order.
        camera.Modified()
        start = time.perf_counter()
        window.Render()
        window.WaitForCompletion()
        times.append(1e3 * (time.perf_counter() - start))
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    grab.Update()
    image = grab.GetOutput()
    pixels = vtk_to_numpy(image.GetPointData().GetScalars())
    pixels = pixels.reshape(size, rays, size, rays, -1)[..., :3].astype(float) / 255
    return pixels.mean((1, 3))[::-1], float(np.median(times[1:]))


def errors(pixels, truth):
    difference = np.abs(pixels - truth[:, :, :3]) * 255
    largest = np.sort(difference.max(2), axis=None)
    return f"{np.sqrt((difference**2).mean()):.2f} / {largest[largest.size * 999 // 1000]:.1f}"


def mappers(name, grid):
    """Names, and what makes the grid and the mapper."""
    casts = [("ray-cast", 0.5), ("ray-cast-fine", 0.1), ("ray-cast-fine-x16", 0.1)]
    if name.startswith("lattice"):
        return [(cast, lambda step=step: ray_caster(step)(grid)) for cast, step in casts]
    n = int(name.split("-")[1])
    rows = []
    for times in [1, 2]:
        def make(m=times * (n - 1) + 1):
            image, missed = resampled(grid, m)
            if missed:
                print(f"{name}: {missed} of {m}³ places have no value", file=sys.stderr)
            return ray_caster(0.5)(image)

        rows.append((f"resample-{times * (n - 1) + 1}", make))
    if name.startswith("tetra"):
        kinds = [
            ("projected", vtk.vtkProjectedTetrahedraMapper),
            ("cell-cast", vtk.vtkUnstructuredGridVolumeRayCastMapper),
            ("z-sweep", vtk.vtkUnstructuredGridVolumeZSweepMapper),
        ]
        for kind_name, kind in kinds:
            make = lambda kind=kind: of_cells(kind)(grid)
            rows += [(kind_name, make), (f"{kind_name}-plain", make)]
    return rows


def main():
    arguments = sys.argv[1:]
    pictures = "--pictures" in arguments
    folder, *words = [Path(arguments[0])] + [a for a in arguments[1:] if a != "--pictures"]
    scene = json.loads((folder / "scene.json").read_text())
    grids = sorted(p.stem for p in folder.glob("*.values"))
    functions = [f["name"] for f in scene["functions"]]
    known = set(grids) | set(functions)

    def wanted(name, kind):
        return name in words or not set(words) & set(kind)

    print("| function | grid | mapper | from the field | ms |\n|---|---|---|---|---|")
    for name in [g for g in grids if wanted(g, grids)]:
        grid = load(folder, name)
        for mapper_name, make in mappers(name, grid):
            if not wanted(mapper_name, set(words) - known):
                continue
            for function in scene["functions"]:
                truth_file = folder / f"truth-{function['name']}.npy"
                if not wanted(function["name"], functions) or not truth_file.exists():
                    continue
                as_rates = mapper_name in ["projected", "cell-cast", "z-sweep"]
                look = tables(function["points"], scene["unit_distance"], as_rates)
                rays = 4 if mapper_name.endswith("x16") else 1
                pixels, ms = draw(scene, make(), look, rays)
                row = errors(pixels, np.load(truth_file).astype(float))
                print(f"| {function['name']} | {name} | {mapper_name} | {row} | {ms:.0f} |", flush=True)
                if pictures:
                    out = f"vtk-{function['name']}-{name}-{mapper_name}.npy"
                    alpha = np.ones(pixels.shape[:2] + (1,))
                    np.save(folder / out, np.concatenate([pixels, alpha], 2).astype("<f4"))


main()
