#!/usr/bin/env python3
"""Times VTK from data on disk to the picture, on the files that `time_to_picture` makes, and this program beside it.

    cargo run --release -p ewa-splat-lab --example time_to_picture          # makes the data
    pip install vtk numpy
    python3 lab/examples/time_to_picture/vtk_times.py FOLDER [--program PROGRAM] [--pictures FOLDER] [WORD ...]

FOLDER has the data; a WORD chooses what has it in its name. Prints Markdown. Every row is a process of its own,
ended after two minutes. Both programs get the same view, 512 x 512, and the same transfer function: the time of
either depends on both. Look at the pictures: they tell a fast mapper from one that drew nothing.

| column | VTK | the program |
|---|---|---|
| read | until the mapper's input is complete: the file, and what is made of it | `read` and `prepare` of `--stats` |
| first | from making the mapper to the pixels in memory | `frame` of `--stats` |
| second | a frame more | the same of a run of two frames, where it is their median |
| CPU | of all threads until the first picture, without starting Python and loading VTK | of the whole command |
| whole | read and first | of the whole command, the picture's file included |

VTK draws without a window, by the OpenGL that it finds: Mesa's `llvmpipe`, on the CPU, where there is no GPU. Mappers
that cast rays or sweep on the CPU use OpenGL only to copy their picture. Volumes are sampled at half a voxel and at
every pixel; VTK has no low-pass filter. Particles are a column density here and sums of Gaussians there.
"""

import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SIZE = 512
FOV_DEG = 30
LIMIT_S = 120
# The program's own convention for views: degrees around z from -y, and above the horizon.
AZIMUTH_DEG, ELEVATION_DEG = 30, 25

# For each data set: its file, the box of the visible part (None: the program fits its own view), the value and the
# length by which the transfer function is scaled, and further arguments of the program.
DATA = {
    "lattice": ("lattice.raw", [(0, 0, 0), (255, 255, 255)], 255, 4, ["--type", "u8", "--dims", "256,256,256"]),
    "sector": ("sector.vts", [(-0.54, 0.09, 0.09), (1.61, 1.88, 1.08)], 1.275, 0.05, []),
    "tetrahedra": ("tetrahedra.vtu", [(0, 0, 0), (1, 1, 1)], 1.275, 0.05, []),
    "particles": ("sph.npy", [(0, 0, 0), (1, 1, 1)], None, None, ["--column-density", "--field", "rho"]),
}
# Fractions of the greatest value, each with a colour and an opacity over the unit of length.
POINTS = [
    (0, [0, 0, 0.5], 0),
    (0.11, [0, 0.2, 0.5], 0),
    (0.47, [0.2, 0.8, 0.6], 0.15),
    (1, [1, 0.9, 0.3], 0.5),
]


def make_white():
    POINTS[:] = [(at, [1, 1, 1], opacity) for at, _, opacity in POINTS]


def view(data):
    """Eye, target, and the height of the picture at the target: visible blobs fill most of it, and all of a cube of
    particles is in it."""
    lower, upper = DATA[data][1]
    target = [(a + b) / 2 for a, b in zip(lower, upper)]
    radius = math.dist(lower, upper) / 2
    around, above = math.radians(AZIMUTH_DEG), math.radians(ELEVATION_DEG)
    towards = [math.sin(around) * math.cos(above), -math.cos(around) * math.cos(above), math.sin(above)]
    distance = 0.62 * radius / math.sin(math.radians(FOV_DEG / 2))
    eye = [t + distance * w for t, w in zip(target, towards)]
    return eye, target, 2 * radius


def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def read(vtk, data, path):
    if data == "lattice":
        reader = vtk.vtkImageReader2()
        reader.SetFileName(str(path))
        reader.SetFileDimensionality(3)
        reader.SetDataExtent(0, 255, 0, 255, 0, 255)
        reader.SetDataScalarTypeToUnsignedChar()
        # Rows in the file's order; otherwise VTK takes the last row as the lowest.
        reader.FileLowerLeftOn()
    elif data == "sector":
        reader = vtk.vtkXMLStructuredGridReader()
        reader.SetFileName(str(path))
    elif data == "tetrahedra":
        reader = vtk.vtkXMLUnstructuredGridReader()
        reader.SetFileName(str(path))
    else:
        return read_particles(vtk, path)
    reader.Update()
    return reader.GetOutput()


def read_particles(vtk, path):
    import numpy as np
    from vtkmodules.util.numpy_support import numpy_to_vtk

    table = np.load(path)
    points = vtk.vtkPoints()
    points.SetData(numpy_to_vtk(np.stack([table["x"], table["y"], table["z"]], 1), deep=True))
    lengths = numpy_to_vtk(np.ascontiguousarray(table["h"]), deep=True)
    lengths.SetName("h")
    cloud = vtk.vtkPolyData()
    cloud.SetPoints(points)
    cloud.GetPointData().AddArray(lengths)
    return cloud


def tetrahedra_of(vtk, grid):
    kind = vtk.vtkDataSetTriangleFilter()
    kind.SetInputData(grid)
    kind.Update()
    return kind.GetOutput()


def lattice_of(vtk, grid):
    kind = vtk.vtkResampleToImage()
    kind.SetInputDataObject(grid)
    kind.SetSamplingDimensions(256, 256, 256)
    kind.Update()
    image = kind.GetOutput()
    image.GetPointData().SetActiveScalars("f")
    return image


def ray_caster(vtk, image):
    mapper = vtk.vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.AutoAdjustSampleDistancesOff()
    mapper.SetImageSampleDistance(1)
    mapper.SetSampleDistance(0.5 * min(image.GetSpacing()))
    return mapper


def shader_caster(vtk, image):
    mapper = vtk.vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.AutoAdjustSampleDistancesOff()
    mapper.SetSampleDistance(0.5 * min(image.GetSpacing()))
    return mapper


def of_cells(name):
    def make(vtk, grid):
        mapper = getattr(vtk, name)()
        mapper.SetInputData(grid)
        if hasattr(mapper, "SetImageSampleDistance"):
            mapper.AutoAdjustSampleDistancesOff()
            mapper.SetImageSampleDistance(1)
        return mapper

    return make


def splatter(vtk, cloud):
    mapper = vtk.vtkPointGaussianMapper()
    mapper.SetInputData(cloud)
    mapper.SetScaleArray("h")
    # Standard deviations: about half of a cubic spline's smoothing length.
    mapper.SetScaleFactor(0.55)
    mapper.EmissiveOn()
    mapper.ScalarVisibilityOff()
    return mapper


PROJECTED = of_cells("vtkProjectedTetrahedraMapper")
CELL_CAST = of_cells("vtkUnstructuredGridVolumeRayCastMapper")
Z_SWEEP = of_cells("vtkUnstructuredGridVolumeZSweepMapper")
# The data set, the conversion, and the mapper.
METHODS = {
    "lattice, vtkFixedPointVolumeRayCastMapper": ("lattice", None, ray_caster),
    "lattice, vtkOpenGLGPUVolumeRayCastMapper": ("lattice", None, shader_caster),
    "sector in tetrahedra, vtkUnstructuredGridVolumeZSweepMapper": ("sector", tetrahedra_of, Z_SWEEP),
    "sector in tetrahedra, vtkUnstructuredGridVolumeRayCastMapper": ("sector", tetrahedra_of, CELL_CAST),
    "sector in tetrahedra, vtkProjectedTetrahedraMapper": ("sector", tetrahedra_of, PROJECTED),
    "sector resampled to 256^3, vtkFixedPointVolumeRayCastMapper": ("sector", lattice_of, ray_caster),
    "tetrahedra, vtkUnstructuredGridVolumeZSweepMapper": ("tetrahedra", None, Z_SWEEP),
    "tetrahedra, vtkUnstructuredGridVolumeRayCastMapper": ("tetrahedra", None, CELL_CAST),
    "tetrahedra, vtkProjectedTetrahedraMapper": ("tetrahedra", None, PROJECTED),
    "particles, vtkPointGaussianMapper": ("particles", None, splatter),
}


def look(vtk, data, as_rates):
    """The transfer function as VTK has it. `as_rates`: mappers of cells take rates of extinction, here in a unit
    that keeps them below 1."""
    _, _, scale, unit, _ = DATA[data]
    colour, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    for at, rgb, _ in POINTS:
        colour.AddRGBPoint(scale * at, *rgb)
    steps = 1000
    greatest = -math.log1p(-max(a for _, _, a in POINTS))
    for n in range(steps + 1):
        at = n / steps
        (x0, _, a0), (x1, _, a1) = next(p for p in zip(POINTS, POINTS[1:]) if at <= p[1][0])
        a = a0 + (a1 - a0) * (at - x0) / (x1 - x0)
        opacity.AddPoint(scale * at, -math.log1p(-a) / greatest if as_rates else a)
    made = vtk.vtkVolumeProperty()
    made.SetColor(colour)
    made.SetScalarOpacity(opacity)
    made.SetScalarOpacityUnitDistance(unit / greatest if as_rates else unit)
    made.SetInterpolationTypeToLinear()
    made.ShadeOff()
    return made


def one(name, folder, picture):
    """In a process of its own: prints times."""
    import vtk

    data, convert, make = METHODS[name]
    cpu, start = time.process_time(), time.perf_counter()
    grid = read(vtk, data, folder / DATA[data][0])
    if convert:
        grid = convert(vtk, grid)
    read_s = time.perf_counter() - start

    start = time.perf_counter()
    mapper = make(vtk, grid)
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(0, 0, 0)
    camera = renderer.GetActiveCamera()
    if data == "particles":
        actor = vtk.vtkActor()
        actor.SetMapper(mapper)
        # The densest pixels stay below white. Channels of 8 bits cannot add such small terms: this pass sums in half floats.
        actor.GetProperty().SetOpacity(0.0025)
        renderer.AddActor(actor)
        steps, sums = vtk.vtkRenderStepsPass(), vtk.vtkToneMappingPass()
        sums.SetToneMappingType(vtk.vtkToneMappingPass.Clamp)
        sums.SetDelegatePass(steps)
        renderer.SetPass(sums)
        camera.ParallelProjectionOn()
    else:
        volume = vtk.vtkVolume()
        volume.SetMapper(mapper)
        volume.SetProperty(look(vtk, data, mapper.IsA("vtkUnstructuredGridVolumeMapper")))
        renderer.AddVolume(volume)
    eye, target, height = view(data)
    camera.SetPosition(*eye)
    camera.SetFocalPoint(*target)
    camera.SetViewUp(0, 0, 1)
    camera.SetViewAngle(FOV_DEG)
    camera.SetParallelScale(height / 2)
    renderer.ResetCameraClippingRange()
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(SIZE, SIZE)
    window.AddRenderer(renderer)

    def frame():
        # Marks the camera as moved each time; otherwise tetrahedra keep their order.
        camera.Modified()
        window.Render()
        grab = vtk.vtkWindowToImageFilter()
        grab.SetInput(window)
        grab.ReadFrontBufferOff()
        # Grab the frame that has been drawn; do not draw another.
        grab.ShouldRerenderOff()
        grab.Update()
        return grab

    grab = frame()
    first_s = time.perf_counter() - start
    cpu_s = time.process_time() - cpu
    if picture:
        writer = vtk.vtkPNGWriter()
        writer.SetFileName(picture)
        writer.SetInputConnection(grab.GetOutputPort())
        writer.Write()
    start = time.perf_counter()
    frame()
    row = {"read": read_s, "first": first_s, "second": time.perf_counter() - start}
    row |= {"cpu": cpu_s, "whole": read_s + first_s, "peak": peak_mb()}
    print(json.dumps(row))


def seconds(s):
    return f"{1000 * s:.0f} ms" if s < 0.1 else f"{s:.2f} s"


def show(name, row):
    cells = [seconds(row[key]) for key in ["read", "first", "second", "cpu", "whole"]]
    print(f"| {name} | {' | '.join(cells)} | {row['peak']:.0f} MB |", flush=True)


def time_vtk(name, folder, pictures):
    picture = ""
    if pictures:
        picture = str(pictures / f"vtk_{name.replace(', ', '_').replace(' ', '_').replace('^', '')}.png")
    command = [sys.executable, __file__, "--one", name, str(folder), picture]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
        show(name, json.loads(done.stdout.splitlines()[-1]))
    except subprocess.TimeoutExpired:
        print(f"| {name} | no picture within {LIMIT_S} s |", flush=True)
    except (IndexError, json.JSONDecodeError):
        reason = (done.stderr.strip() or "no word").splitlines()[-1]
        print(f"| {name} | ended with status {done.returncode}: {reason} |", flush=True)


def command_of(program, data, folder, scratch):
    """The program's command, without the options for what it writes."""
    file, box, scale, unit, arguments = DATA[data]
    command = [program, "render", str(folder / file), "--backend", "cpu", "--size", f"{SIZE}x{SIZE}"]
    if box is None:
        return command + arguments
    eye, target, height = view(data)
    command += ["--eye=" + ",".join(map(str, eye)), "--target=" + ",".join(map(str, target))]
    if scale:
        points = [{"value": scale * v, "color": c, "opacity": a} for v, c, a in POINTS]
        function = {"range": [0, scale], "unit_distance": unit, "points": points}
        (scratch / "function.json").write_text(json.dumps(function))
        command += ["--fov", str(FOV_DEG), "--transfer-function", str(scratch / "function.json")]
    else:
        command += ["--ortho", str(height)]
    return command + arguments


def time_program(program, data, folder, pictures):
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        stats = scratch / "stats.json"
        picture = (pictures or scratch) / f"program_{data}.png"
        command = command_of(program, data, folder, scratch)
        command += ["--stats", str(stats), "--out", str(picture)]
        rows = []
        for extra in [[], ["--frames", "2"]]:
            start = time.perf_counter()
            child = subprocess.Popen(command + extra, stderr=subprocess.DEVNULL)
            _, status, used = os.wait4(child.pid, 0)
            whole = time.perf_counter() - start
            child.returncode = os.waitstatus_to_exitcode(status)
            if child.returncode:
                print(f"| {data} | ended with status {child.returncode} |", flush=True)
                return
            times = json.loads(stats.read_text())["times_ms"]
            row = {"read": (times["read"] + times["prepare"]) / 1e3, "first": times["frame"] / 1e3}
            row |= {"cpu": used.ru_utime + used.ru_stime, "whole": whole}
            rows.append(row | {"peak": used.ru_maxrss * 1024 / 1e6})
        show(f"{data}, this program", rows[0] | {"second": rows[1]["first"]})


def main():
    arguments = sys.argv[1:]
    if arguments[:1] == ["--white"]:
        make_white()
        arguments.pop(0)
    if arguments[:1] == ["--one"]:
        one(arguments[1], Path(arguments[2]), arguments[3])
        return

    def option(name):
        if name not in arguments:
            return None
        at = arguments.index(name)
        arguments.pop(at)
        return arguments.pop(at)

    program, pictures = option("--program"), option("--pictures")
    if not arguments:
        sys.exit(__doc__)
    folder, *words = arguments
    folder, pictures = Path(folder), pictures and Path(pictures)
    version = subprocess.run(
        [sys.executable, "-c", "import vtk; print(vtk.vtkVersion().GetVTKVersion())"],
        capture_output=True, text=True, check=True,
    ).stdout.strip()
    print(f"VTK {version}\n\n| work | read | first | second | CPU | whole | peak memory |\n|---|---|---|---|---|---|---|")
    for data in DATA:
        chosen = [m for m in METHODS if METHODS[m][0] == data and (not words or any(w in m for w in words))]
        if program and chosen:
            time_program(program, data, folder, pictures)
        for name in chosen:
            time_vtk(name, folder, pictures)


if __name__ == "__main__":
    main()
