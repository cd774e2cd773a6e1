"""Libraries of the system that pictures take."""

import ctypes
import os
import sys

OFF_SCREEN = ("libEGL.so.1", "libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
"""Any of these lets VTK draw without a display, on Linux."""
ON_SCREEN = "libGL.so.1"
"""This does so where there is a display."""


def need_drawing() -> None:
    """Raise OSError if the system lacks a library to draw with: VTK would crash without a word."""
    if sys.platform != "linux":
        return
    libraries = (*OFF_SCREEN, ON_SCREEN) if os.environ.get("DISPLAY") else OFF_SCREEN
    if not any(map(_loads, libraries)):
        message = (
            "a picture needs the library EGL or OSMesa, and the system has neither; install it, "
            "on Debian and Ubuntu by: apt-get install libegl1"
        )
        raise OSError(message)


def _loads(library: str) -> bool:
    """Whether the system finds a library and can load it."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
