"""What drivers print: nothing where there is no desktop."""

import os
import subprocess
import sys

import pytest


def told(**variables):
    """What a process finds in NODEVICE_SELECT once it has imported the package."""
    names = ("XDG_RUNTIME_DIR", "NODEVICE_SELECT", "DRI_PRIME", "MESA_VK_DEVICE_SELECT")
    environment = {name: value for name, value in os.environ.items() if name not in names}
    code = "import os, ewa_splat; print(os.environ.get('NODEVICE_SELECT'))"
    run = subprocess.run(
        [sys.executable, "-c", code], env={**environment, **variables}, capture_output=True, text=True, check=True
    )
    return run.stdout.strip()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Mesa's layer")
def test_the_layer_that_complains_is_left_out_without_a_desktop():
    assert told() == "1"
    assert told(XDG_RUNTIME_DIR="relative") == "1"
    assert told(XDG_RUNTIME_DIR="/run/user/1000") == "None"
    assert told(DRI_PRIME="1") == "None"
    assert told(NODEVICE_SELECT="0") == "0"
