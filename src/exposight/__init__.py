"""exposight: exposure time and point-cloud quality for active 3D sensors, predicted beforehand.

The names that most scripts need, each imported when it is first used::

    import exposight as xs

    campaign = xs.open_campaign("door")
    train, test = campaign.observe().split(by="feature", share=0.8, seed=1)
    models = xs.train(train, sensor=campaign.sensor)
    print(models.evaluate(test))
    print(models.forecast(campaign.view(pose)))
    xs.measure(xs.read_plan("plan.toml"), driver, "new")

Everything else is in the rooms: `exposight.cell`, `exposight.imaging`, `exposight.observing`,
`exposight.models`, `exposight.planning`, `exposight.gp`, ….
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # what editors and mypy see of `_ROOMS`
    from exposight.cell import (
        ActiveSensor,
        Capture,
        Cloud,
        Driver,
        Feature,
        Part,
        read_features,
        read_sensor,
        sensor_preset,
    )
    from exposight.errors import ExposightError
    from exposight.geometry import RigidTransform
    from exposight.imaging import decode
    from exposight.measuring.measure import measure
    from exposight.models import ModelSpecification, Prediction, Predictor, load_model, save_model
    from exposight.observing import Campaign, ObservationTable, open_campaign, read_observations
    from exposight.planning import Forecast, SensorModels, plan, read_exposure_plan, train
    from exposight.plans import plan_preset, read_plan

__version__ = "0.1.0"

_ROOMS = {
    "cell": (
        "ActiveSensor", "Capture", "Cloud", "Driver", "Feature", "Part", "read_features",
        "read_sensor", "sensor_preset",
    ),
    "errors": ("ExposightError",),
    "geometry": ("RigidTransform",),
    "imaging": ("decode",),
    "measuring": ("measure",),
    "models": ("ModelSpecification", "Prediction", "Predictor", "load_model", "save_model"),
    "observing": ("Campaign", "ObservationTable", "open_campaign", "read_observations"),
    "planning": ("Forecast", "SensorModels", "plan", "read_exposure_plan", "train"),
    "plans": ("plan_preset", "read_plan"),
}  # fmt: skip
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}
__all__ = ["__version__", *_ROOM_OF]


def __getattr__(name: str) -> object:
    """Import a public name when it is first used (PEP 562)."""
    if name not in _ROOM_OF:
        msg = f"module 'exposight' has no attribute {name!r}"
        raise AttributeError(msg)
    globals()[name] = value = getattr(import_module(f"exposight.{_ROOM_OF[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
