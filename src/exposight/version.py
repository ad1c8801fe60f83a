"""The version of exposight."""

__version__ = "0.1.0"
