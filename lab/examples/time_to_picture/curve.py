#!/usr/bin/env python3
"""Measures the trade between time and error: this program at tolerances from 1/1000 to 1/4, and VTK on the same files.

    cargo run --release -p ewa-splat-lab --example time_to_picture          # makes the data
    pip install vtk numpy
    python3 lab/examples/time_to_picture/curve.py FOLDER PROGRAM CURVE.svg [WORD ...]

FOLDER has the data; a WORD chooses what has it in its name. Prints Markdown, and draws all points in one plot.

Errors are differences from the picture drawn at 1/10000 without levels of detail, in levels of 255, over all pixels:
their root mean square, and what 99.9 of 100 pixels stay below. Volumes are white over black, because VTK composites
colours in another space. VTK's errors have other causes, too: steps along rays, trilinear values, resampling. It draws no
picture of kernels' depths and no filtered texture, so that particles and surfels have no points of it.

Frames are medians of three further ones. What is done once is not among them: reading, sampling, refining and, for large
lattices, the choice of the level.
"""

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from vtk_times import DATA, LIMIT_S, command_of, make_white, seconds

TOLERANCES = [1000, 255, 128, 64, 32, 16, 8, 4]

# For each plot: its data, further arguments of the program, and the method of VTK.
CURVES = {
    "regular lattice, 256³": ("lattice", [], "lattice, vtkFixedPointVolumeRayCastMapper"),
    "curvilinear grid, 128³": ("sector", [], "sector resampled to 256^3, vtkFixedPointVolumeRayCastMapper"),
    "944,784 tetrahedra": ("tetrahedra", [], "tetrahedra, vtkProjectedTetrahedraMapper"),
    "1,000,000 particles": ("cloud", [], None),
    "textured box, surfels": ("box", [], None),
}
# Data beside those of VTK's times, with a view of the program's own.
DATA["cloud"] = ("sph.npy", None, None, None, ["--field", "rho"])
DATA["box"] = ("box.obj", None, None, None, [])

COLOURS = ["#b33c2e", "#1f6fb2", "#1b8a62", "#c77d0a", "#a24b8f"]
LEAST_ERROR = 1e-3


def read_png(path):
    """Returns the colours of a picture, 0 to 1, rows from the top."""
    import vtk
    from vtkmodules.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkPNGReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    width, height, _ = image.GetDimensions()
    values = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, -1)
    return values[::-1, :, :3] / 255.0


def own_points(program, data, arguments, folder, scratch):
    """Yields the tolerance, the most accurate picture, the picture and the statistics of each point."""
    command = command_of(program, data, folder, scratch) + arguments

    def picture(*extra):
        stats, out = scratch / "stats.json", scratch / "picture.npy"
        rest = ["--background", "0,0,0", "--stats", str(stats), "--out", str(out)]
        subprocess.run(command + rest + list(extra), check=True, stderr=subprocess.DEVNULL)
        return np.load(out)[..., :3], json.loads(stats.read_text())

    truth, _ = picture("--tolerance", "0.0001", "--level-of-detail", "off")
    for parts in TOLERANCES:
        tolerance = ["--tolerance", str(1 / parts)]
        # The choice of a level is part of the first frame alone.
        first = picture(*tolerance)[1]["times_ms"] if data == "lattice" else {}
        colours, stats = picture(*tolerance, "--frames", "3")
        stats["choice"] = first.get("choose", 0)
        yield f"1/{parts}", truth, colours, stats


def vtk_point(method, folder, scratch):
    png = scratch / "vtk.png"
    script = str(Path(__file__).with_name("vtk_times.py"))
    command = [sys.executable, script, "--white", "--one", method, str(folder), str(png)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=True)
    return read_png(png), json.loads(done.stdout.splitlines()[-1])["second"]


def errors(colours, truth):
    off = 255 * np.abs(colours - truth)
    return np.sqrt(np.mean(off**2)), np.quantile(off, 0.999)


def curve(name, program, folder):
    """Prints a table; returns the points (time, error, name), those of VTK last, and the number of these."""
    data, arguments, method = CURVES[name]
    points = []
    print(f"\n**{name}**\n\n| tolerance | frame | footprints | RMS | 99.9 % | |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        for tolerance, truth, colours, stats in own_points(program, data, arguments, folder, scratch):
            frame, (rms, most) = stats["times_ms"]["frame"] / 1e3, errors(colours, truth)
            level = stats.get("lattice_level", 0)
            choice = f"{level} halvings, chosen in {seconds(stats['choice'] / 1e3)}" if stats["choice"] else ""
            footprints = f"{stats['footprints']:,}"
            print(f"| {tolerance} | {seconds(frame)} | {footprints} | {rms:.3f} | {most:.2f} | {choice} |", flush=True)
            points.append((frame, rms, tolerance))
        if method:
            colours, frame = vtk_point(method, folder, scratch)
            rms, most = errors(colours, truth)
            mapper = method.split(", ")[-1]
            print(f"| `{mapper}` | {seconds(frame)} | | {rms:.3f} | {most:.2f} | |", flush=True)
            points.append((frame, rms, mapper))
    return points, int(method is not None)


def plot(curves):
    """Draws time against error on logarithmic axes: a line for each data set, rings for VTK."""
    width, height, left, right, top, bottom = 900, 560, 70, 20, 16, 52
    times = [p[0] for points, _ in curves.values() for p in points]
    found = [max(p[1], LEAST_ERROR) for points, _ in curves.values() for p in points]

    def axis(values, low, high):
        first, last = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))
        return range(first, last + 1), lambda v: low + (high - low) * (math.log10(v) - first) / max(last - first, 1)

    times, x = axis(times, left, width - right)
    found, y = axis(found, height - bottom, top)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" '
        'font-size="13" fill="#2b2f36">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for n in times:
        at, text = x(10**n), f"{10**n:g} s"
        out.append(f'<path d="M{at:.1f} {top}V{height - bottom}" stroke="#e6e8ec"/>')
        out.append(f'<text x="{at:.1f}" y="{height - bottom + 18}" text-anchor="middle">{text}</text>')
    for n in found:
        at = y(10**n)
        out.append(f'<path d="M{left} {at:.1f}H{width - right}" stroke="#e6e8ec"/>')
        out.append(f'<text x="{left - 8}" y="{at + 4:.1f}" text-anchor="end">{10**n:g}</text>')
    out.append(f'<text x="{(left + width - right) / 2}" y="{height - 10}" text-anchor="middle">frame</text>')
    middle = (top + height - bottom) / 2
    out.append(
        f'<text transform="translate(16 {middle}) rotate(-90)" text-anchor="middle">'
        "error, RMS in levels of 255</text>"
    )
    for n, (name, (points, of_vtk)) in enumerate(curves.items()):
        colour = COLOURS[n % len(COLOURS)]
        places = [(x(time), y(max(error, LEAST_ERROR)), label) for time, error, label in points]
        own = places[: len(places) - of_vtk]
        line = " ".join(f"{a:.1f},{b:.1f}" for a, b, _ in own)
        out.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        for i, (a, b, label) in enumerate(places):
            is_own = i < len(own)
            fill, radius = (colour, 4) if is_own else ("white", 7)
            tip = f"<title>{name}: {label}</title>"
            ring = f'fill="{fill}" stroke="{colour}" stroke-width="2"'
            out.append(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="{radius}" {ring}>{tip}</circle>')
            if not is_own:
                out.append(f'<text x="{a + 11:.1f}" y="{b + 4:.1f}" fill="{colour}">VTK</text>')
            elif label in ("1/1000", "1/4"):
                out.append(f'<text x="{a + 7:.1f}" y="{b - 6:.1f}" fill="{colour}" font-size="11">{label}</text>')
            elif label == "1/255":
                where = f'x="{a - 8:.1f}" y="{b + 13:.1f}" text-anchor="end"'
                out.append(f'<text {where} fill="{colour}" font-size="11">{label}</text>')
        out.append(f'<text x="{width - right - 8}" y="{top + 18 + 18 * n}" text-anchor="end" fill="{colour}">{name}</text>')
    out.append("</svg>\n")
    return "\n".join(out)


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    folder, program, out, *words = sys.argv[1:]
    make_white()
    chosen = [name for name in CURVES if not words or any(word in name for word in words)]
    curves = {name: curve(name, program, Path(folder)) for name in chosen}
    Path(out).write_text(plot(curves))


if __name__ == "__main__":
    main()
