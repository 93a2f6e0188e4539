"""Column densities of a million particles by this program, swiftsimio and py-sphviewer2: CPU seconds, clock, errors.

    pip install numpy h5py numba swiftsimio py-sphviewer2
    python lab/examples/column_peers.py target/release/ewa-splat

The truth is the mean over each pixel of the projected kernel, at 8 x 8 or 4 x 4 points of a pixel, in f64.
"""

import resource
import subprocess
import sys
import time

import h5py
import numba
import numpy as np
import sphviewer2
from swiftsimio.visualisation.projection_backends import backends_parallel

SIDE = 1024
COUNT = 1_000_000
#: Support radius over smoothing length, of Wendland's C2 as swiftsimio has it.
GAMMA = 1.936492


def projected(kernel):
    """Tabulate the integral of a kernel along lines, by distance over the support radius, with unit integral."""
    distances = np.linspace(0.0, 1.0, 4097)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    values = np.zeros_like(distances)
    for i, distance in enumerate(distances):
        end = np.sqrt(1.0 - distance**2)
        joint = np.sqrt(max(0.25 - distance**2, 0.0))
        for low, high in ((0.0, joint), (joint, end)):
            along = 0.5 * (high - low) * nodes + 0.5 * (high + low)
            values[i] += (high - low) * weights @ kernel(np.sqrt(distance**2 + along**2))
    return values / np.trapezoid(values * 2 * np.pi * distances, distances)


CUBIC = projected(lambda r: np.where(r < 0.5, 1 - 6 * r**2 + 6 * r**3, 2 * np.clip(1 - r, 0, 1) ** 3))
WENDLAND = projected(lambda r: np.clip(1 - r, 0, 1) ** 4 * (1 + 4 * r))


@numba.njit(parallel=True)
def pixel_means(places, masses, radii, table, samples):
    """Sum the kernels at samples x samples points of each pixel."""
    bands = 64
    rows = SIDE // bands
    image = np.zeros((SIDE, SIDE))
    for band in numba.prange(bands):
        first, last = band * rows, (band + 1) * rows
        for i in range(len(places)):
            x, y, radius = places[i, 0] * SIDE, places[i, 1] * SIDE, radii[i] * SIDE
            peak = masses[i] / (radii[i] * radii[i] * samples * samples)
            for row in range(max(first, int(y - radius)), min(last, int(y + radius) + 1)):
                for column in range(max(0, int(x - radius)), min(SIDE, int(x + radius) + 1)):
                    for v in range(samples):
                        dy = row + (v + 0.5) / samples - y
                        for u in range(samples):
                            dx = column + (u + 0.5) / samples - x
                            at = np.sqrt(dx * dx + dy * dy) / radius * (len(table) - 1)
                            if at < len(table) - 1:
                                k = int(at)
                                image[row, column] += peak * (table[k] + (at - k) * (table[k + 1] - table[k]))
    return image


def write(path, places, masses, radii):
    """Write a snapshot as Gadget does."""
    with h5py.File(path, "w") as file:
        gas = file.create_group("PartType0")
        gas["Coordinates"], gas["Masses"], gas["SmoothingLength"] = places, masses, radii
        gas["Density"] = masses / radii**3
        counts = [len(masses), 0, 0, 0, 0, 0]
        said = {"NumPart_ThisFile": counts, "NumPart_Total": counts, "MassTable": [0.0] * 6, "BoxSize": 1.0, "Time": 1.0}
        file.create_group("Header").attrs.update(said | {"NumFilesPerSnapshot": 1})


def used():
    """Return the CPU seconds of this process and of its children."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def say(name, draw, truth):
    """Draw twice, and print the second run's times and the rms error over the rms of the picture about its mean."""
    draw()
    cpu, clock = used(), time.perf_counter()
    image = draw()
    cpu, clock = used() - cpu, time.perf_counter() - clock
    error = "" if truth is None else f", error {np.sqrt(((image - truth) ** 2).mean()) / truth.std():.2%}"
    print(f"{name}: {cpu:.2f} s CPU, {clock:.2f} s{error}", flush=True)


def main(program):
    for width, samples in ((3.9, 8), (12.3, 4)):
        random = np.random.default_rng(1)
        places, masses = random.random((COUNT, 3)), random.random(COUNT) + 0.5
        radii = width / SIDE * (0.8 + 0.4 * random.random(COUNT))
        write("column_peers.hdf5", places, masses, radii)
        print(f"support radius {width} px")
        truths = {table: pixel_means(places, masses, radii, of, samples) for table, of in (("cubic", CUBIC), ("wendland-c2", WENDLAND))}
        for kernel, truth in (*truths.items(), ("gaussian", truths["cubic"])):
            words = "render column_peers.hdf5 --column-density --along z --window 0,1,0,1 --size 1024x1024 --backend cpu"
            words = [program, *words.split(), "--kernel", kernel, "--out", "column_peers.npy"]

            def draw():
                subprocess.run(words, check=True, capture_output=True)
                return np.load("column_peers.npy")[::-1]

            say(f"ewa-splat, whole command, {kernel}", draw, truth)
        single = {"m": masses.astype(np.float32), "h": (radii / GAMMA).astype(np.float32)}
        for name in ("fast", "subsampled"):
            draw = lambda: backends_parallel[name](x=places[:, 0], y=places[:, 1], res=SIDE, box_x=0.0, box_y=0.0, **single).T
            say(f"swiftsimio, {name}", draw, truths["wendland-c2"])
        draw = lambda: sphviewer2.render(*places.T, radii, masses, 1.0, periodic=False, r_max=10, num_threads=2)[0]
        # Its kernel is another.
        say("py-sphviewer2", draw, None)


if __name__ == "__main__":
    main(sys.argv[1])
