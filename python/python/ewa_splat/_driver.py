"""Graphics drivers' messages on standard error."""

from __future__ import annotations

import os
import sys

# Variables by which somebody chooses a device through Mesa's layer.
_CHOICES = ("DRI_PRIME", "MESA_VK_DEVICE_SELECT")


def quiet() -> None:
    """Keep Mesa quiet where there is no desktop.

    Its layer for choosing devices asks a Wayland display for its own, and prints `error: XDG_RUNTIME_DIR is invalid` for
    each try where that variable is unset or no absolute path. Nothing here needs the layer: `NODEVICE_SELECT` leaves it
    out, unless the environment chooses a device by it.
    """
    has_desktop = os.path.isabs(os.environ.get("XDG_RUNTIME_DIR", ""))
    if sys.platform.startswith("linux") and not has_desktop and not any(name in os.environ for name in _CHOICES):
        os.environ.setdefault("NODEVICE_SELECT", "1")
