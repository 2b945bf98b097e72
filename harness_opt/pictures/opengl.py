"""pyvista when it is asked for, and a kind of OpenGL window that works where no screen is to be had.

pyvista, and VTK with it, is imported inside the functions: it costs a second.

Without a screen VTK 9.7 tries X11, EGL and OSMesa in turn, and takes the whole process down with a segmentation
fault where it finds none, or no libX11 or libXcursor. So :func:`_off_screen_window` looks for them first and
tells VTK which to take.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from harness_opt.errors import HarnessError

WINDOW_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
REMEDY = "install it (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri), or leave --pictures and --film out"


def load_pyvista() -> Any:
    """Return the package, imported when it is needed.

    Raises:
        HarnessError: it is not installed; one line with the remedy.
    """
    try:
        import pyvista
    except ImportError as error:
        raise HarnessError('found no pyvista, expected the extra "harness-opt[pictures]"') from error
    return pyvista


@contextmanager
def drawable() -> Iterator[None]:
    """Let VTK make an off-screen window of the kind that works here, without a word on stderr.

    Raises:
        HarnessError: none does.
    """
    load_pyvista()
    before = os.environ.get(WINDOW_VARIABLE)
    with quiet():
        window = before or _off_screen_window()
    if window:
        os.environ[WINDOW_VARIABLE] = window  # VTK reads it when a window is made, and has no other way to ask
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(WINDOW_VARIABLE, None)


@contextmanager
def quiet() -> Iterator[None]:
    """Keep VTK from warning on stderr of what was only tried."""
    from vtkmodules.vtkCommonCore import vtkLogger

    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)


def _off_screen_window() -> str | None:
    """Return the name of the kind of window that VTK can draw in without a screen; None leaves it to VTK."""
    if not sys.platform.startswith("linux"):
        return None
    from vtkmodules import vtkRenderingOpenGL2 as gl

    if _loads("libEGL.so.1") and gl.vtkEGLRenderWindow().SupportsOpenGL():
        return "vtkEGLRenderWindow"
    if has_screen():
        return "vtkXOpenGLRenderWindow"
    if any(_loads(f"libOSMesa.so.{version}") for version in (8, 6)):
        return "vtkOSOpenGLRenderWindow"
    raise HarnessError(f"found no OpenGL that works (EGL, X11 or OSMesa), expected one: {REMEDY}")


def has_screen() -> bool:
    """Whether an X server answers and can draw."""
    from vtkmodules import vtkRenderingOpenGL2 as gl

    asked = os.environ.get("DISPLAY") and _loads("libX11.so.6") and _loads("libXcursor.so.1")
    return bool(asked) and bool(gl.vtkXOpenGLRenderWindow().SupportsOpenGL())


def _loads(library: str) -> bool:
    """Whether the system has a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
