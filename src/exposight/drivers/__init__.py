"""Drivers of cells other than the simulated one."""

from exposight.drivers.replay import ReplayDriver
