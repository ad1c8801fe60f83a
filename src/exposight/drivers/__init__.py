"""Drivers of cells other than the simulated one."""

from exposight.drivers.cell_file import Cell, CellFile, read_cell
from exposight.drivers.genicam import GenicamDriver
from exposight.drivers.rc_visard import RcVisardDriver
from exposight.drivers.replay import ReplayDriver
