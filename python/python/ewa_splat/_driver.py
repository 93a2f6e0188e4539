"""Suppresses messages of graphics drivers on standard error."""

from __future__ import annotations

import os
import sys

# Variables by which a user chooses a device through Mesa's layer.
_CHOICES = ("DRI_PRIME", "MESA_VK_DEVICE_SELECT")


def quiet() -> None:
    """Suppress Mesa's complaints on machines without a desktop.

    Mesa's device-selection layer asks a Wayland display for its device. It prints `error: XDG_RUNTIME_DIR is invalid` at
    each try if that variable is unset or not an absolute path. Nothing here needs the layer, and `NODEVICE_SELECT`
    disables it. If the environment chooses a device through the layer, it stays enabled.
    """
    has_desktop = os.path.isabs(os.environ.get("XDG_RUNTIME_DIR", ""))
    if sys.platform.startswith("linux") and not has_desktop and not any(name in os.environ for name in _CHOICES):
        os.environ.setdefault("NODEVICE_SELECT", "1")
