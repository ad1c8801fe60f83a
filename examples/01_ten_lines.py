"""Ten lines: a campaign becomes models, and a view is judged before anything is taken there.

The campaign is taken by the simulated cell first, so that there is one.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import exposight as xs
from exposight.plans import DepthPlane, MeasuringPlan
from exposight.twin import SimulatedCell

PLAN = MeasuringPlan(
    name="a few views",
    sensor=xs.sensor_preset("comet-pro-ae"),
    features=("f1", "f2", "f3", "f4"),
    reference="f1",
    planes=(
        DepthPlane(
            name="middle",
            z_tcp_mm=-5.0,
            x_mm=(-100.0, 0.0, 100.0),
            y_mm=(0.0,),
            exposures_ms=(5.0, 12.0, 30.0, 70.0),
        ),
    ),
)


def main(folder: Path) -> None:
    """Measure, learn from the measurement, and forecast a view."""
    driver = SimulatedCell.for_plan(PLAN, rings_only=True)
    xs.measure(PLAN, driver, folder / "door")

    campaign = xs.open_campaign(folder / "door")
    train, test = campaign.observe().split(by="feature", share=0.75, seed=1)
    models = xs.train(train, sensor=campaign.sensor)
    print(models.evaluate(test))
    pose = next(campaign.captures()).camera_from_part
    view = campaign.view(pose)
    forecast = models.forecast(view)
    print(forecast)


if __name__ == "__main__":
    with TemporaryDirectory() as temporary:
        main(Path(temporary))
