"""Drivers of cells other than the simulated one."""

from collections.abc import Mapping
from types import MappingProxyType

from exposight.drivers.cell_file import Cell, CellFile, read_cell
from exposight.drivers.genicam import GenicamDriver
from exposight.drivers.rc_visard import RcVisardDriver
from exposight.drivers.replay import ReplayDriver

DEVICES: Mapping[str, type[GenicamDriver] | type[RcVisardDriver]] = MappingProxyType(
    {"genicam": GenicamDriver, "rc_visard": RcVisardDriver}
)
"""Drivers of a cell's file, by the name that commands and requests give them."""
