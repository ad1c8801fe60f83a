"""Aravis, the library that speaks GigE Vision and USB3 Vision, as Debian packages it."""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
import sys
import warnings
from functools import cache
from typing import Any

from exposight.errors import SensorError

_SYSTEM_PACKAGES = "/usr/lib/python3/dist-packages"
"""Where Debian keeps Python's GObject interface, which a virtual environment does not see."""

_HOW_TO_INSTALL = (
    "cameras are reached through Aravis 0.8: on Debian and Ubuntu install the packages "
    "gir1.2-aravis-0.8 and python3-gi, elsewhere Aravis with its introspection data and PyGObject"
)


@cache
def aravis() -> Any:
    """Return Aravis's GObject interface.

    Raises
    ------
    SensorError
        If it is not installed; the message says what to install.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # PyGObject imports as Python did before 3.12
            gi = sys.modules.get("gi") or _gi()
            gi.require_version("Aravis", "0.8")
            return importlib.import_module("gi.repository.Aravis")
    except (ImportError, ValueError) as error:
        msg = f"{_HOW_TO_INSTALL}; got: {error}"
        raise SensorError(msg) from error


@cache
def aravis_error() -> type[Exception]:
    """Return the exception that Aravis's calls raise."""
    aravis()
    return importlib.import_module("gi.repository.GLib").Error  # type: ignore[no-any-return]


def _gi() -> Any:
    """Import ``gi``, from the system's packages where this environment has none.

    Its folder does not come on the path: nothing else there belongs to this environment.
    """
    try:
        return importlib.import_module("gi")
    except ImportError:
        spec = importlib.machinery.PathFinder.find_spec("gi", [_SYSTEM_PACKAGES])
        if spec is None or spec.loader is None:
            raise
    module = importlib.util.module_from_spec(spec)
    sys.modules["gi"] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules["gi"]
        raise
    return module
