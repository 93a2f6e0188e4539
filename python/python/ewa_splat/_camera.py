"""Defines cameras."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ._arrays import vector

#: Default vertical field of view, degrees.
DEFAULT_FOV = 35.0


class Camera:
    """Camera of a picture. It has no size until something is drawn.

    Make one with `look_at`, `fit`, `along` or `from_pyvista`. A picture stores the camera that it was drawn with (`Image.camera`).

    Examples
    --------
    >>> import ewa_splat as es
    >>> es.Camera.look_at((0, -5, 1), (0, 0, 0))
    Camera.look_at((0, -5, 1), (0, 0, 0), up=(0, 0, 1), fov=35)
    >>> es.Camera.fit(elevation=60).orbit(90)
    Camera.fit(azimuth=+90, elevation=60)
    """

    def __init__(self, view: dict[str, Any]) -> None:
        self._view = view

    @classmethod
    def look_at(
        cls,
        eye: Sequence[float],
        target: Sequence[float],
        up: Sequence[float] = (0.0, 0.0, 1.0),
        *,
        fov: float = DEFAULT_FOV,
        ortho_height: float | None = None,
    ) -> Camera:
        """Make a camera at a position.

        Parameters
        ----------
        eye, target, up
            Positions in world units, and a direction. `up` need not be perpendicular to the view.
        fov
            The full angle from the picture's top to its bottom, degrees, 1 to 179.
        ortho_height
            In place of `fov`: the height of an orthographic picture, world units.
        """
        view: dict[str, Any] = {
            "kind": "look_at",
            "eye": vector(eye, "eye"),
            "target": vector(target, "target"),
            "up": vector(up, "up"),
        }
        if view["eye"] == view["target"]:
            raise ValueError(f"eye: expected another place than the target, found both at {view['eye']}")
        return cls(view | _lens(fov, ortho_height))

    @classmethod
    def fit(
        cls,
        *,
        azimuth: float | None = None,
        elevation: float | None = None,
        zoom: float | None = None,
        up: Sequence[float] | None = None,
        fov: float | None = None,
        ortho_height: float | None = None,
        orthographic: bool = False,
        around: bool = False,
    ) -> Camera:
        """Make a camera that shows all that is visible, as large as possible. Defaults depend on the data.

        Parameters
        ----------
        azimuth, elevation
            Degrees around the direction up, and above the horizon.
        zoom
            Magnification.
        up
            Direction that points up in the picture.
        fov, ortho_height
            As in `look_at`.
        orthographic
            Whether the picture is orthographic, with the height of the data.
        around
            Whether to show the full sphere around the data, which has the same size from every direction.
        """
        view: dict[str, Any] = {"kind": "fit"}
        for name, value in (("azimuth", azimuth), ("elevation", elevation), ("zoom", zoom)):
            if value is not None:
                view[name] = _finite(value, name)
        if zoom is not None and zoom <= 0:
            raise ValueError(f"zoom: expected a number above 0, found {zoom}")
        if up is not None:
            view["up"] = _direction(up)
        if fov is not None or ortho_height is not None:
            view |= _lens(fov if fov is not None else DEFAULT_FOV, ortho_height)
        if orthographic:
            view["orthographic"] = True
        if around:
            view["around"] = True
        return cls(view)

    @classmethod
    def along(
        cls,
        axis: str,
        *,
        centre: Sequence[float] | None = None,
        width: float | None = None,
    ) -> Camera:
        """Make an orthographic camera that looks along an axis, as figures of papers do.

        Along x, y runs to the right and z up; along y, x and z; along z, x and y. With a minus sign the picture is seen
        from behind, and the axis to the right runs to the left.

        Parameters
        ----------
        axis
            ``"x"``, ``"y"``, ``"z"``, ``"-x"``, ``"-y"`` or ``"-z"``.
        centre
            The point in the middle of the picture [default: the data's].
        width
            Width of the picture, world units [default: fitted to the data].

        Examples
        --------
        >>> import ewa_splat as es
        >>> es.Camera.along("z", centre=(5, 5, 5), width=2)
        Camera.along('z', centre=(5, 5, 5), width=2)
        """
        known = [sign + name for sign in ("", "-") for name in "xyz"]
        if axis not in known:
            raise ValueError(f"axis: expected one of {', '.join(known)}, found {axis!r}")
        view: dict[str, Any] = {"kind": "along", "axis": axis}
        if centre is not None:
            view["centre"] = vector(centre, "centre")
        if width is not None:
            view["ortho_width"] = _finite(width, "width")
            if view["ortho_width"] <= 0:
                raise ValueError(f"width: expected a number above 0, found {width}")
        return cls(view)

    @classmethod
    def from_pyvista(cls, camera_position: Any, *, view_angle: float = 30.0) -> Camera:
        """Make a camera from that of a PyVista plotter.

        Parameters
        ----------
        camera_position
            ``plotter.camera_position``, (position, focal point, view up); or ``plotter.camera`` or another `vtkCamera`,
            which also have an angle and a projection. `ewa_splat.vtk.camera_of` knows a window's shifts, too.
        view_angle
            The vertical field of view, degrees; VTK's default is 30.
        """
        if hasattr(camera_position, "GetViewUp"):
            camera = camera_position
            scale = 2.0 * camera.GetParallelScale() if camera.GetParallelProjection() else None
            place = (camera.GetPosition(), camera.GetFocalPoint(), camera.GetViewUp())
            return cls.look_at(*place, fov=camera.GetViewAngle(), ortho_height=scale)
        position, focal_point, up = list(camera_position)
        return cls.look_at(position, focal_point, up, fov=view_angle)

    def to_pyvista(self, camera: Any = None) -> list[tuple[float, float, float]]:
        """Return (position, focal point, view up) for ``plotter.camera_position``, which has no projection.

        Parameters
        ----------
        camera
            ``plotter.camera`` or another `vtkCamera`, if it is to be set: position, direction up, the angle or the
            parallel projection with its scale, and the picture's middle.

        Raises
        ------
        ValueError
            A camera that is fitted when something is drawn. `Image.camera` is the fitted camera.
        """
        view = self._view
        scale = angle = None
        middle = (0.0, 0.0)
        if view["kind"] == "look_at":
            place = [tuple(view["eye"]), tuple(view["target"]), tuple(view["up"])]
            if view.get("ortho_height") is not None:
                scale = view["ortho_height"] / 2.0
            angle = view.get("fov", DEFAULT_FOV)
        elif view["kind"] == "calibrated":
            right, down, forward = np.array(view["rotation"])
            eye = np.array(view["eye"])
            place = [tuple(map(float, v)) for v in (eye, eye + forward, -down)]
            # Half of the picture's height, in world units or as a slope.
            half = view["size"][1] / (2.0 * view["focal_px"][1])
            if view.get("orthographic"):
                scale = half
            angle = math.degrees(2.0 * math.atan(half))
            size, centre = view["size"], view.get("centre_px")
            if centre is not None:
                middle = (1.0 - 2.0 * centre[0] / size[0], 2.0 * centre[1] / size[1] - 1.0)
        else:
            raise ValueError("camera: expected one with a place, found one that is fitted to data; take Image.camera")
        if camera is not None:
            camera.SetWindowCenter(*middle)
            if hasattr(camera, "up"):
                # PyVista keeps more than VTK does, behind attributes of its own.
                camera.position, camera.focal_point, camera.up = place
                camera.parallel_projection = scale is not None
            else:
                camera.SetPosition(place[0])
                camera.SetFocalPoint(place[1])
                camera.SetViewUp(place[2])
                camera.SetParallelProjection(scale is not None)
            if scale is None:
                camera.SetViewAngle(angle)
            else:
                camera.SetParallelScale(scale)
        return place

    def orbit(self, azimuth: float = 0.0, elevation: float = 0.0) -> Camera:
        """Return this camera, turned around its target: around the direction up, then above the horizon, degrees.

        A fitted camera then shows the sphere around the data, so that the data keep their size and are not cut off.
        """
        view = dict(self._view)
        if view["kind"] == "fit":
            view["around"] = True
            view["turn"] = view.get("turn", 0.0) + _finite(azimuth, "azimuth")
            view["rise"] = view.get("rise", 0.0) + _finite(elevation, "elevation")
            return Camera(view)
        if view["kind"] != "look_at":
            found = "one along an axis" if view["kind"] == "along" else "a calibrated one"
            raise ValueError(f"camera: expected one that looks at a target, found {found}")
        up = np.array(view["up"]) / np.linalg.norm(view["up"])
        offset = np.array(view["eye"]) - np.array(view["target"])
        offset = _turned(offset, up, math.radians(azimuth))
        side = np.cross(offset, up)
        length = float(np.linalg.norm(side))
        if elevation and length > 0:
            offset = _turned(offset, side / length, math.radians(elevation))
        view["eye"] = [float(x) for x in np.array(view["target"]) + offset]
        return Camera(view)

    def zoomed(self, factor: float) -> Camera:
        """Return this camera with a longer lens, which shows everything `factor` times as large."""
        if not factor > 0 or not math.isfinite(factor):
            raise ValueError(f"factor: expected a number above 0, found {factor}")
        view = dict(self._view)
        if view["kind"] == "fit":
            view["zoom"] = view.get("zoom", 1.0) * factor
        elif view["kind"] == "calibrated":
            view["focal_px"] = [f * factor for f in view["focal_px"]]
        elif view["kind"] == "along":
            if "ortho_width" not in view:
                raise ValueError("camera: expected one with a width, found one that is fitted to data; take Image.camera")
            view["ortho_width"] /= factor
        elif "ortho_height" in view:
            view["ortho_height"] /= factor
        else:
            half = math.tan(math.radians(view["fov"]) / 2.0) / factor
            view["fov"] = math.degrees(2.0 * math.atan(half))
        return Camera(view)

    @property
    def eye(self) -> tuple[float, float, float] | None:
        """The position, world units; ``None`` for a camera that is fitted when something is drawn."""
        eye = self._view.get("eye")
        return None if eye is None else (eye[0], eye[1], eye[2])

    @property
    def fov(self) -> float | None:
        """The vertical field of view, degrees; ``None`` if the camera is orthographic or the data decide."""
        view = self._view
        if view["kind"] == "calibrated":
            if view["orthographic"]:
                return None
            return math.degrees(2.0 * math.atan(view["size"][1] / (2.0 * view["focal_px"][1])))
        fov = view.get("fov")
        return None if fov is None else float(fov)

    def _asked(self) -> dict[str, Any]:
        """Return the form that the compiled part accepts."""
        return self._view

    def __repr__(self) -> str:
        view = self._view

        def listed(numbers: Sequence[float]) -> str:
            return f"({', '.join(f'{x:g}' for x in numbers)})"

        if view["kind"] == "calibrated":
            width, height = view["size"]
            return f"Camera(at {listed(view['eye'])}, {width} x {height} px)"
        if view["kind"] == "look_at":
            lens = f"fov={view['fov']:g}" if "fov" in view else f"ortho_height={view['ortho_height']:g}"
            return f"Camera.look_at({listed(view['eye'])}, {listed(view['target'])}, up={listed(view['up'])}, {lens})"
        if view["kind"] == "along":
            said = [repr(view["axis"])]
            if "centre" in view:
                said.append(f"centre={listed(view['centre'])}")
            if "ortho_width" in view:
                said.append(f"width={view['ortho_width']:g}")
            return f"Camera.along({', '.join(said)})"
        said = []
        for name, turn in (("azimuth", "turn"), ("elevation", "rise")):
            if name in view:
                said.append(f"{name}={view[name] + view.get(turn, 0.0):g}")
            elif view.get(turn):
                said.append(f"{name}={view[turn]:+g}")
        for name in ("zoom", "fov", "ortho_height"):
            if name in view:
                said.append(f"{name}={view[name]:g}")
        return f"Camera.fit({', '.join(said)})"


def _finite(value: float, name: str) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{name}: expected a finite number, found {value}")
    return number


def _direction(up: Sequence[float]) -> list[float]:
    direction = np.array(vector(up, "up"))
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise ValueError("up: expected three numbers that are not all zero")
    return [float(x) for x in direction / length]


def _lens(fov: float, ortho_height: float | None) -> dict[str, float]:
    if ortho_height is not None:
        height = _finite(ortho_height, "ortho_height")
        if height <= 0:
            raise ValueError(f"ortho_height: expected a number above 0, found {ortho_height}")
        return {"ortho_height": height}
    if not 1.0 <= float(fov) <= 179.0:
        raise ValueError(f"fov: expected degrees from 1 to 179, found {fov}")
    return {"fov": float(fov)}


def _turned(offset: Any, axis: Any, angle: float) -> Any:
    """Rotate a vector about an axis by Rodrigues' formula."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return offset * cosine + np.cross(axis, offset) * sine + axis * np.dot(axis, offset) * (1.0 - cosine)
