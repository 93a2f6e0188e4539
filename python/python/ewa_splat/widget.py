"""Shows a picture in a notebook, which the user turns with the mouse. Needs anywidget.

Everything runs in the kernel: the browser shows PNG pictures and sends mouse movements. The picture is refined at rest.

Examples
--------
>>> from ewa_splat.widget import Widget  # doctest: +SKIP
>>> Widget(volume, size=(640, 480))  # doctest: +SKIP
"""

from __future__ import annotations

from typing import Any

import anywidget
import traitlets

from ._camera import Camera
from ._renderer import Renderer

#: Degrees of rotation per pixel of mouse movement.
DEGREES_PER_PIXEL = 0.4

_SCRIPT = """
function render({ model, el }) {
  const image = document.createElement("img");
  image.style.touchAction = "none";
  image.draggable = false;
  el.appendChild(image);
  let url = null;
  const show = () => {
    const bytes = model.get("png");
    if (!bytes || !bytes.byteLength) return;
    if (url) URL.revokeObjectURL(url);
    url = URL.createObjectURL(new Blob([bytes], { type: "image/png" }));
    image.src = url;
    image.width = model.get("width");
  };
  model.on("change:png", show);
  let last = null, moved = [0, 0], isWaiting = false, rest = null;
  const tell = () => {
    if (moved[0] || moved[1]) {
      isWaiting = true;
      model.send({ turn: moved });
      moved = [0, 0];
    }
  };
  model.on("msg:custom", () => { isWaiting = false; tell(); });
  const refineSoon = () => {
    clearTimeout(rest);
    rest = setTimeout(() => model.send({ rest: true }), 250);
  };
  image.onpointerdown = (event) => { last = [event.clientX, event.clientY]; image.setPointerCapture(event.pointerId); };
  image.onpointermove = (event) => {
    if (!last) return;
    moved = [moved[0] + event.clientX - last[0], moved[1] + event.clientY - last[1]];
    last = [event.clientX, event.clientY];
    if (!isWaiting) tell();
    refineSoon();
  };
  image.onpointerup = () => { last = null; refineSoon(); };
  image.onwheel = (event) => {
    event.preventDefault();
    model.send({ zoom: Math.exp(-event.deltaY / 500) });
    refineSoon();
  };
  show();
  return () => { clearTimeout(rest); if (url) URL.revokeObjectURL(url); };
}
export default { render };
"""


class Widget(anywidget.AnyWidget):
    """Picture of things that the user turns with the mouse and zooms with its wheel.

    Parameters
    ----------
    *things
        Things that a `Renderer` accepts, or one renderer.
    size
        Width and height in pixels.
    camera
        Fitted camera of the first picture.
    **settings
        As in `Renderer.render`.
    """

    _esm = _SCRIPT
    png = traitlets.Bytes(b"").tag(sync=True)
    width = traitlets.Int(0).tag(sync=True)

    def __init__(
        self, *things: Any, size: tuple[int, int] = (640, 480), camera: Camera | None = None, **settings: Any
    ) -> None:
        super().__init__()
        is_renderer = len(things) == 1 and isinstance(things[0], Renderer)
        self._renderer = things[0] if is_renderer else Renderer(*things)
        self._size, self._settings = size, settings
        self._camera = (camera if camera is not None else Camera.fit()).orbit()
        self.width = size[0]
        self.on_msg(self._told)
        self._draw(is_coarse=False)

    @property
    def camera(self) -> Camera:
        """The current camera."""
        return self._camera

    def _told(self, _: object, message: dict[str, Any], __: object) -> None:
        if "turn" in message:
            x, y = message["turn"]
            self._camera = self._camera.orbit(-DEGREES_PER_PIXEL * x, DEGREES_PER_PIXEL * y)
        if "zoom" in message:
            self._camera = self._camera.zoomed(message["zoom"])
        self._draw(is_coarse="rest" not in message)
        # The browser sends the next motion only after this picture has arrived.
        self.send({"drawn": True})

    def _draw(self, *, is_coarse: bool) -> None:
        width, height = self._size
        size, settings = self._size, dict(self._settings)
        if is_coarse:
            size = (max(width // 2, 1), max(height // 2, 1))
            settings["tolerance"] = max(8 / 255, settings.get("tolerance", 0.0))
        self.png = self._renderer.render(self._camera, size, **settings).png()
