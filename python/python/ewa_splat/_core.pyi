"""The compiled part of ewa_splat: contiguous arrays in, arrays out. Use the package around it."""

from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

@final
class Drawable:
    @staticmethod
    def points(
        positions: NDArray[Any], columns: Sequence[tuple[str, NDArray[Any]]], options: dict[str, Any] | None = None
    ) -> Drawable: ...
    @staticmethod
    def grid(
        dims: Sequence[int],
        origin: Sequence[float],
        step: Sequence[Sequence[float]],
        name: str,
        values: NDArray[Any],
        of: str,
        options: dict[str, Any] | None = None,
    ) -> Drawable: ...
    @staticmethod
    def rectilinear(
        coordinates: Sequence[Sequence[float]],
        name: str,
        values: NDArray[Any],
        of: str,
        options: dict[str, Any] | None = None,
    ) -> Drawable: ...
    @staticmethod
    def structured(
        dims: Sequence[int],
        points: NDArray[Any],
        name: str,
        values: NDArray[Any],
        of: str,
        options: dict[str, Any] | None = None,
    ) -> Drawable: ...
    @staticmethod
    def cells(
        points: NDArray[Any],
        cells: NDArray[np.int64],
        kinds: NDArray[np.uint8],
        name: str,
        values: NDArray[Any],
        of: str,
        options: dict[str, Any] | None = None,
    ) -> Drawable: ...
    @staticmethod
    def mesh(
        vertices: NDArray[Any],
        faces: NDArray[np.uint32],
        colours: NDArray[np.float32] | None = None,
        uv: NDArray[np.float64] | None = None,
        texture: tuple[int, int, NDArray[np.uint8]] | None = None,
        values: tuple[str, NDArray[Any]] | None = None,
        of: str = "nodes",
        options: dict[str, Any] | None = None,
    ) -> Drawable: ...
    @staticmethod
    def surfels(
        positions: NDArray[Any],
        normals: NDArray[Any],
        radii: NDArray[np.float64],
        colours: NDArray[np.float32] | None,
        up: Sequence[float] | None,
    ) -> Drawable: ...
    @staticmethod
    def splats(
        positions: NDArray[Any],
        scales: NDArray[np.float32],
        rotations: NDArray[np.float32],
        opacities: NDArray[np.float32],
        degree: int,
        harmonics: NDArray[np.float32],
        options: dict[str, Any] | None = None,
    ) -> Drawable: ...
    @staticmethod
    def open(path: str, options: dict[str, Any] | None = None, how: dict[str, Any] | None = None) -> Drawable: ...
    @staticmethod
    def read(
        name: str, bytes: bytes, options: dict[str, Any] | None = None, how: dict[str, Any] | None = None
    ) -> Drawable: ...
    @staticmethod
    def together(things: Sequence[Drawable]) -> Drawable: ...
    def fields(self) -> list[str]: ...
    def showing(self, field: str) -> Drawable: ...
    def parts(self) -> tuple[Any, ...]: ...
    def notes(self) -> list[str]: ...
    def bounds(self) -> tuple[list[float], list[float]] | None: ...
    def report(self) -> dict[str, Any]: ...
    def convert(
        self, path: str, width: float | None, lit: bool | None, lights: list[list[float]] | None
    ) -> tuple[int, int, list[str]]: ...

@final
class Deep:
    def counts(self) -> NDArray[np.int64]: ...
    def samples(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]: ...
    def before(self, depth: NDArray[np.float32] | None) -> NDArray[np.float32]: ...
    def transmittance(self, depth: float) -> NDArray[np.float32]: ...
    def depth(self, of: str) -> NDArray[np.float32]: ...
    def write(self, path: str) -> None: ...

class Renderer:
    def __new__(cls, things: Sequence[Drawable], backend: str, keep_shapes: bool) -> Renderer: ...
    def render(self, view: dict[str, Any] | None, size: Sequence[int], said: dict[str, Any] | None) -> dict[str, Any]: ...
    def render_deep(
        self, view: dict[str, Any] | None, size: Sequence[int], said: dict[str, Any] | None
    ) -> tuple[Deep, dict[str, Any]]: ...
    def column_density(
        self,
        view: dict[str, Any] | None,
        size: Sequence[int],
        said: dict[str, Any] | None,
        of: str | None,
        mean: str | None,
        slice: float | None,
    ) -> dict[str, Any]: ...
    def reference(
        self, of: str, view: dict[str, Any] | None, size: Sequence[int], error: float, said: dict[str, Any] | None
    ) -> dict[str, Any]: ...
    def pick(
        self, pixel: Sequence[int], view: dict[str, Any] | None, size: Sequence[int], said: dict[str, Any] | None
    ) -> list[tuple[int, int, float | None, tuple[float, float, float], float, float]]: ...
    def measure(self, view: dict[str, Any] | None, size: Sequence[int], frames: int, error: float) -> str: ...
    def set_values(self, thing: int, values: NDArray[Any]) -> None: ...
    def set_transfer_function(self, said: dict[str, Any]) -> None: ...
    def transfer_functions(self) -> list[str | None]: ...
    def adapter(self) -> str | None: ...

def check_transfer_function(text: str) -> None: ...
def write_image(pixels: NDArray[np.float32], path: str | None, transparent: bool) -> bytes | None: ...
def read_image(path: str) -> NDArray[np.float32]: ...
def column_colours(
    values: NDArray[np.float32], map: str | None, range: Sequence[float] | None, scale: str | None
) -> NDArray[np.float32]: ...
def column_look(
    values: NDArray[np.float32], map: str | None, scale: str | None
) -> tuple[str, str, list[float] | None]: ...
def write_column(values: NDArray[np.float32], pixel_area: float | None, path: str) -> None: ...
def compare(first: NDArray[np.float32], second: NDArray[np.float32]) -> str: ...
def main(words: Sequence[str]) -> None: ...
