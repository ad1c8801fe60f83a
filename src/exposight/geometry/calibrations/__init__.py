"""Calibrations as programs write them: nodes of a file, recognised by shape and name."""
