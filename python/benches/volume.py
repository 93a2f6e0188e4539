"""Times what Python adds: a volume of float32 points and values, importing the package, a picture.

    python python/benches/volume.py [COUNT]

The library's own call is what is left of making a volume without bringing arrays into its types.
"""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np


def seconds(work) -> tuple[float, object]:
    begun = time.perf_counter()
    done = work()
    return time.perf_counter() - begun, done


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000
    whole = [
        [float(x) for x in subprocess.run([sys.executable, "-c", IMPORT], capture_output=True, text=True, check=True).stdout.split()]
        for _ in range(9)
    ]
    both, own = min(pair[0] for pair in whole), min(pair[1] for pair in whole)
    print(f"import: {both * 1e3:.0f} ms with NumPy, {own * 1e3:.0f} ms without")

    import ewa_splat as es

    random = np.random.default_rng(1)
    places, values = random.random((count, 3), np.float32), random.random(count, np.float32)
    wrapping, volume = seconds(lambda: es.Volume.from_points(places, values))
    sampling, _ = seconds(lambda: volume.report)
    # The data set is kept and a copy of it is sampled: 28 bytes a point.
    copied = np.ones(28 * count, np.uint8)
    copying, _ = seconds(copied.copy)
    library = sampling - copying
    print(f"{count} points: arrays to vectors {wrapping:.3f} s, copy {copying:.3f} s, the library's call {library:.3f} s")
    print(f"in all {(wrapping + sampling) / library:.3f} times the library's call")

    small = es.Volume.from_points(places[:20_000], values[:20_000])
    renderer = es.Renderer(small, backend="cpu")
    renderer.render(size=(800, 600))
    frames = []
    for _ in range(9):
        taken, image = seconds(lambda: renderer.render(size=(800, 600)))
        frames.append((taken - image.stats["times_ms"]["frame"] / 1e3, taken))
    beyond, taken = sorted(frames)[len(frames) // 2]
    print(f"a picture of 800 x 600: {taken * 1e3:.1f} ms, of which {beyond * 1e3:.1f} ms are not the frame's")


IMPORT = """
import time
begun = time.perf_counter()
import numpy
between = time.perf_counter()
import ewa_splat
ended = time.perf_counter()
print(ended - begun, ended - between)
"""

if __name__ == "__main__":
    main()
