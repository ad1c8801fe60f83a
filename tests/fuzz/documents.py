"""Documents in JSON and TOML: sensors, plans, scenes, …"""

from __future__ import annotations

from pathlib import Path

from tests.fuzz.formats import Format, Sample

from exposight.cell import read_sensor, sensor_preset


def _sensors(folder: Path) -> list[Sample]:
    path = folder / "sensor.json"
    path.write_text(sensor_preset("rc-visard-65").to_json())
    return [Sample(path)]


FORMATS = (Format("sensor JSON", _sensors, read_sensor),)
