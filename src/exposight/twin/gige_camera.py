"""A GigE Vision camera on loopback that sends frames of ours: Aravis's fake camera, filled by us.

The frames go through `ctypes`: the introspected interface cannot write into a buffer, nor keep a
callback beyond the call that sets it.
"""

from __future__ import annotations

import ctypes
import logging
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

from exposight.aravis_library import aravis
from exposight.cell import ExposureRange, Image
from exposight.errors import SensorError
from exposight.files import write_durably
from exposight.twin.request_server import LOOPBACK

logger = logging.getLogger(__name__)

_PORT = 3956
"""Of GigE Vision's control channel."""

_LIBRARY = "libaravis-0.8.so.0"

_FillPattern = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)

# Registers of Aravis's fake camera that its GObject interface does not name.
_XML = """<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="{model}" VendorName="exposight" StandardNameSpace="None"
  SchemaMajorVersion="1" SchemaMinorVersion="0" SchemaSubMinorVersion="1"
  MajorVersion="1" MinorVersion="0" SubMinorVersion="0" ToolTip="Served simulated cell"
  ProductGuid="0" VersionGuid="0" xmlns="http://www.genicam.org/GenApi/Version_1_0">
  <Category Name="Root" NameSpace="Standard">
    <pFeature>Width</pFeature><pFeature>Height</pFeature><pFeature>PixelFormat</pFeature>
    <pFeature>PayloadSize</pFeature><pFeature>AcquisitionMode</pFeature>
    <pFeature>AcquisitionStart</pFeature><pFeature>AcquisitionStop</pFeature>
    <pFeature>TriggerMode</pFeature><pFeature>ExposureTime</pFeature>
  </Category>
  <Integer Name="Width" NameSpace="Standard"><pValue>WidthReg</pValue></Integer>
  <Integer Name="Height" NameSpace="Standard"><pValue>HeightReg</pValue></Integer>
  <Integer Name="SensorWidth" NameSpace="Standard"><pValue>WidthReg</pValue></Integer>
  <Integer Name="SensorHeight" NameSpace="Standard"><pValue>HeightReg</pValue></Integer>
  <IntSwissKnife Name="PayloadSize" NameSpace="Standard">
    <pVariable Name="W">WidthReg</pVariable><pVariable Name="H">HeightReg</pVariable>
    <Formula>W * H</Formula>
  </IntSwissKnife>
  <Enumeration Name="PixelFormat" NameSpace="Standard">
    <EnumEntry Name="Mono8" NameSpace="Standard"><Value>17301505</Value></EnumEntry>
    <pValue>PixelFormatReg</pValue>
  </Enumeration>
  <Enumeration Name="AcquisitionMode" NameSpace="Standard">
    <EnumEntry Name="Continuous" NameSpace="Standard"><Value>1</Value></EnumEntry>
    <EnumEntry Name="SingleFrame" NameSpace="Standard"><Value>2</Value></EnumEntry>
    <pValue>AcquisitionModeReg</pValue>
  </Enumeration>
  <Command Name="AcquisitionStart" NameSpace="Standard">
    <pValue>AcquisitionReg</pValue><CommandValue>1</CommandValue>
  </Command>
  <Command Name="AcquisitionStop" NameSpace="Standard">
    <pValue>AcquisitionReg</pValue><CommandValue>0</CommandValue>
  </Command>
  <Enumeration Name="TriggerMode" NameSpace="Standard">
    <EnumEntry Name="Off" NameSpace="Standard"><Value>0</Value></EnumEntry>
    <EnumEntry Name="On" NameSpace="Standard"><Value>1</Value></EnumEntry>
    <pValue>TriggerModeReg</pValue>
  </Enumeration>
  <Float Name="ExposureTime" NameSpace="Standard">
    <pValue>ExposureConverter</pValue><Min>{low_us}</Min><Max>{high_us}</Max>
  </Float>
  <Converter Name="ExposureConverter" NameSpace="Custom">
    <FormulaTo>FLOOR(FROM / {step_us} + 0.5) * {step_us}</FormulaTo>
    <FormulaFrom>TO</FormulaFrom><pValue>ExposureReg</pValue>
  </Converter>
{registers}
  <Port Name="Device" NameSpace="Standard"/>
</RegisterDescription>
"""

_REGISTER = (
    '  <IntReg Name="{name}" NameSpace="Custom"><Address>{address}</Address><Length>4</Length>'
    "<AccessMode>{access}</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign>"
    "<Endianess>BigEndian</Endianess></IntReg>"
)

_REGISTERS = {
    "WidthReg": ("WIDTH", "RO"),
    "HeightReg": ("HEIGHT", "RO"),
    "PixelFormatReg": ("PIXEL_FORMAT", "RO"),
    "AcquisitionModeReg": ("ACQUISITION_MODE", "RW"),
    "AcquisitionReg": ("ACQUISITION", "RW"),
    "TriggerModeReg": ("TRIGGER_MODE", "RW"),
    "ExposureReg": ("EXPOSURE_TIME_US", "RW"),
}


def genicam_xml(model: str, exposure: ExposureRange, rounding_us: int) -> str:
    """Return the description of a camera that programs read from it.

    Parameters
    ----------
    model : str
    exposure : ExposureRange
        In whole µs.
    rounding_us : int, µs
        To whose multiples it rounds exposure times, without saying so.
    """
    library = aravis()
    registers = (
        _REGISTER.format(
            name=name, address=getattr(library, f"FAKE_CAMERA_REGISTER_{place}"), access=access
        )
        for name, (place, access) in _REGISTERS.items()
    )
    return _XML.format(
        model=model,
        low_us=f"{1000.0 * exposure.min_ms:.1f}",
        high_us=f"{1000.0 * exposure.max_ms:.1f}",
        step_us=f"{rounding_us}.0",
        registers="\n".join(registers),
    )


class GigeCamera:
    """A camera of 8 bits that answers on loopback until it is closed, or its process ends.

    Parameters
    ----------
    folder : Path
        Where its description is written.
    serial : str
        Its serial number, up to 15 characters.
    size : (int, int), px
        Rows and columns of its frames.
    exposure : ExposureRange
    frame : callable
        Returns the frame to send at an exposure time in ms, uint8 of that size.
    rounding_us : int, µs
        As for `genicam_xml`.

    Raises
    ------
    SensorError
        If Aravis is not installed, or another GigE Vision camera is served on loopback.
    """

    def __init__(
        self,
        folder: Path,
        serial: str,
        size: tuple[int, int],
        exposure: ExposureRange,
        frame: Callable[[float], Image],
        *,
        rounding_us: int = 1,
    ) -> None:
        library = aravis()
        path = folder / "genicam.xml"
        write_durably(path, genicam_xml("cell", exposure, rounding_us).encode())
        _check_port()
        self._served: Any = library.GvFakeCamera.new_full(LOOPBACK, serial, str(path))
        if not self._served.is_running():
            self._served = None
            msg = f"Aravis serves no camera on {LOOPBACK}; is the loopback interface up?"
            raise SensorError(msg)
        self._camera = self._served.get_fake_camera()
        self._size, self._frame = size, frame
        for name, value in {
            "SENSOR_HEIGHT": size[0],
            "SENSOR_WIDTH": size[1],
            "HEIGHT": size[0],
            "WIDTH": size[1],
            "EXPOSURE_TIME_US": round(1000.0 * exposure.min_ms),
        }.items():
            self._camera.write_register(getattr(library, f"FAKE_CAMERA_REGISTER_{name}"), value)
        self._exposure_register = library.FAKE_CAMERA_REGISTER_EXPOSURE_TIME_US
        self._library = ctypes.CDLL(_LIBRARY)
        self._library.arv_buffer_get_data.restype = ctypes.c_void_p
        self._library.arv_buffer_get_data.argtypes = (ctypes.c_void_p, ctypes.c_void_p)
        set_fill = self._library.arv_fake_camera_set_fill_pattern
        set_fill.argtypes = (ctypes.c_void_p, _FillPattern, ctypes.c_void_p)
        self._fill = _FillPattern(self._fill_buffer)  # must live as long as the camera
        set_fill(hash(self._camera), self._fill, None)  # a GObject's hash is its address

    @property
    def exposure_ms(self) -> float:
        """Exposure time that is set now."""
        answer = self._camera.read_register(self._exposure_register)
        return float(answer[-1] if isinstance(answer, tuple) else answer) / 1000.0

    def _fill_buffer(self, buffer: int, _: int, exposure_us: int, _gain: int, _kind: int) -> None:
        try:
            frame = self._frame(exposure_us / 1000.0)
        except Exception:  # nobody above this could take it
            logger.exception("no frame at %g ms", exposure_us / 1000.0)
            return
        data = self._library.arv_buffer_get_data(buffer, ctypes.byref(ctypes.c_size_t()))
        if data and frame.shape == self._size and self._camera.get_payload() >= frame.nbytes:
            ctypes.memmove(data, frame.tobytes(), frame.nbytes)

    def close(self) -> None:
        """End the camera."""
        self._served = self._camera = None


def _check_port() -> None:
    """Check that no other camera is served: Aravis would share its port, and answers would mix.

    Raises
    ------
    SensorError
        If one is.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((LOOPBACK, _PORT))
        except OSError as error:
            msg = (
                f"no GigE Vision camera can be served on {LOOPBACK}: another one is, on the only "
                f"port that the protocol has (UDP {_PORT}); end that one first"
            )
            raise SensorError(msg) from error
