"""exposight: exposure time and point-cloud quality for active 3D sensors, predicted beforehand."""

__version__ = "0.1.0"
