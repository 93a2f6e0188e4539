"""Films of the program, decoded by dav1d in PyAV, if it is installed."""

import numpy as np
import pytest
from conftest import FIXTURES

av = pytest.importorskip("av")


def test_a_decoder_sees_the_pictures(run, tmp_path):
    image = pytest.importorskip("PIL.Image")
    scene = [str(FIXTURES / "vase.glb"), "--size", "161x121", "--turntable", 6, "--backend", "cpu"]
    for out in (["--rate", 10, "--out", tmp_path / "a.mp4"], ["--out", tmp_path / "%d.png"]):
        result = run("render", *scene, *out)
        assert result.returncode == 0, result.stderr
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height, stream.average_rate) == (161, 121, 10)
        # BT.709's primaries and matrix, the curve of sRGB, limited range.
        context = stream.codec_context
        assert (context.color_primaries, context.color_trc, context.colorspace, context.color_range) == (1, 13, 1, 1)
        frames = list(container.decode(stream))
    assert [round(frame.time * 10) for frame in frames] == list(range(6))
    weights = np.array([0.2126, 0.7152, 0.0722])
    for i, frame in enumerate(frames):
        luma = np.frombuffer(frame.planes[0], np.uint8).reshape(-1, frame.planes[0].line_size)[:121, :161]
        shown = (luma.astype(float) - 16) * 255 / 219
        drawn = np.asarray(image.open(tmp_path / f"{i}.png").convert("RGB")).astype(float) @ weights
        # 51 dB at 480 x 360 pixels; smaller pictures have more edges.
        assert 10 * np.log10(255**2 / np.mean((shown - drawn) ** 2)) > 44
        # The background, #1c1c21, in a corner, within the rounding of luma and chroma and the quantizer.
        corner = frame.to_ndarray(format="rgb24")[2, 2].astype(int)
        assert np.abs(corner - [0x1C, 0x1C, 0x21]).max() <= 3
