"""A turn around a volume, as an animation: one renderer, many pictures."""

from _arguments import FIXTURES, arguments

import ewa_splat as es

FRAMES = 12

size, out = arguments(__doc__)
renderer = es.Renderer(es.load(FIXTURES / "wake.xyz"))
camera = es.Camera.fit(elevation=30)
frames = []
for i in range(FRAMES):
    image = renderer.render(camera.orbit(360 * i / FRAMES), size, transfer_function=FIXTURES / "wake_transfer.json")
    frames.append(image.to_pil().convert("RGB"))
    print(f"frame {i}: {image.stats['times_ms']['frame']:.1f} ms")
frames[0].save(out / "turntable.gif", save_all=True, append_images=frames[1:], duration=100, loop=0)
