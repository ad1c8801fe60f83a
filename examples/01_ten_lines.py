"""Ten lines: a campaign becomes models, which plan captures and correct themselves while measuring.

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
    """Measure, learn from the measurement, recommend, plan, and measure in a closed loop."""
    driver = SimulatedCell.for_plan(PLAN, rings_only=True)
    xs.measure(PLAN, driver, folder / "door")

    campaign = xs.open_campaign(folder / "door")
    train, test = campaign.observe().split(by="feature", share=0.75, seed=1)
    models = xs.train(train, sensor=campaign.sensor)
    print(models.evaluate(test))
    poses = {each.view: each.camera_from_part for each in campaign.descriptions()}
    view = campaign.view(poses["middle-x1-y1"])
    print(models.recommend(view, confidence=0.9))
    plan = xs.plan(models, campaign.part, poses)
    print(plan)
    print(xs.measure(plan, driver, folder / "new", models=models))


if __name__ == "__main__":
    with TemporaryDirectory() as temporary:
        main(Path(temporary))
