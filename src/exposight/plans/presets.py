"""The paper's campaigns by name: one measuring plan for each row of its Table 9.

Table 9 lists which features were observed, at which exposure times, and the ranges of their poses;
Sect. 3.2 says how positions were planned. Where neither gives a number it is chosen here so that
the features' poses span the table's ranges on this part, and said to be assumed. Rows of exposure
models (eX) are rows of quality models without observations below p_norm 0.75, so they share plans.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Final

from exposight.cell import ActiveSensor, sensor_preset
from exposight.errors import InputError, did_you_mean
from exposight.plans import positions
from exposight.plans.plan import MeasuringPlan

_SEED = 1
_COMET, _VISARD = sensor_preset("comet-pro-ae"), sensor_preset("rc-visard-65")

_TRAINING = ("f1", "f2", "f3", "f4")
_MORE_TRAINING = ("f5", "f6", "f7", "f8", "f9")
_TEST = ("f1_test", "f2_test", "f3_test", "f4_test")
_OUTSIDE = ("f1_out", "f2_out", "f3_out", "f4_out", "f5_out")

# 4 × 4 positions in each of three planes: 48 (Sect. 3.2.1 and its 480 measurements). Table 9 gives
# the ranges over all features; f1's are assumed to be the symmetric part of them.
_NEAR = positions.DepthPlane(
    name="near",
    z_tcp_mm=-165.0,
    x_mm=positions.even_positions(-135, 135, 4),
    y_mm=positions.even_positions(-100, 100, 4),
    exposures_ms=(5, 7, 10, 14, 19, 26, 37, 51, 72, 100),
)
# Measurements of the front plane were aligned by the robot's kinematics alone (Sect. 3.2.2: some
# were). All are taken as such: none of the plane's places is measured better than 0.9 in the paper.
_SIMULATED_NEAR = {"kinematic_share": {_NEAR.name: 1.0}}
_MIDDLE = positions.DepthPlane(
    name="middle",
    z_tcp_mm=-5.0,
    x_mm=positions.even_positions(-225, 225, 4),
    y_mm=positions.even_positions(-150, 150, 4),
    exposures_ms=(5, 7, 11, 16, 23, 33, 48, 70, 103, 150),
)
_FAR = positions.DepthPlane(
    name="far",
    z_tcp_mm=155.0,
    x_mm=positions.even_positions(-230, 230, 4),
    y_mm=positions.even_positions(-200, 200, 4),
    # 225 as printed; the logarithmic scale would have 255.
    exposures_ms=(20, 27, 38, 52, 71, 98, 135, 185, 225, 350),
)
# eX⁺⁺: exposures as in Table 9, x and y finer (Sect. 3.4.8); 5 × 5 is assumed.
_FINER = positions.DepthPlane(
    name="middle-finer",
    z_tcp_mm=-5.0,
    x_mm=positions.even_positions(-225, 225, 5),
    y_mm=positions.even_positions(-150, 150, 5),
    exposures_ms=tuple(float(ms) for ms in range(5, 121, 5)),
)

_FEW_EXPOSURES = (15.0, 40.0, 65.0, 90.0, 115.0)
"""Lighting and outside rows of Table 9."""

_STEREO_EXPOSURES = positions.logarithmic_exposures(0.07, 18.0, 16, _VISARD)
"""Table 9 gives 0.07 to 18 ms; a logarithmic scale as for the other sensor, and 16, are assumed."""


def _inside(
    name: str, planes: tuple[positions.DepthPlane, ...], features: tuple[str, ...] = _TRAINING
) -> MeasuringPlan:
    return MeasuringPlan(
        name=name,
        sensor=_COMET,
        features=features,
        reference="f1",
        planes=planes,
        simulated=_SIMULATED_NEAR if _NEAR.name in [plane.name for plane in planes] else {},
        # Test features are measured in the same views (Table 9); some views see none of them.
        blind_views="skip" if features == _TEST else "refuse",
        seed=_SEED,
    )


def _lighting(name: str, lighting: str) -> MeasuringPlan:
    """One position, five exposures (Sect. 4.1); f4_test was not observed."""
    position = positions.DepthPlane(
        name="single",
        z_tcp_mm=-5.0,
        x_mm=(-70.0,),  # assumed: all three features are well in the frame
        y_mm=(55.0,),
        exposures_ms=_FEW_EXPOSURES,
    )
    plan = _inside(name, (position,), _TEST[:3])
    return replace(plan, reference="f1_test", simulated={"lighting": lighting})


def _stereo(name: str, features: tuple[str, ...]) -> MeasuringPlan:
    """Finer in space (Sect. 4.2.1): 8 × 6 positions in five planes are assumed."""
    planes = tuple(
        positions.DepthPlane(
            name=f"plane-{number}",
            z_tcp_mm=z,
            x_mm=positions.even_positions(-x, x, 8),
            y_mm=positions.even_positions(top, bottom, 6),
            exposures_ms=_STEREO_EXPOSURES,
        )
        for number, (z, x, top, bottom) in enumerate(
            (
                (-165.0, 130.0, -100.0, 40.0),
                (-85.0, 155.0, -115.0, 45.0),
                (-5.0, 180.0, -125.0, 50.0),
                (75.0, 205.0, -140.0, 55.0),
                (155.0, 230.0, -150.0, 60.0),
            ),
            start=1,
        )
    )
    return replace(_inside(name, planes, features), sensor=_VISARD)


def _outside(name: str, sensor: ActiveSensor, box: positions.RandomPositions) -> MeasuringPlan:
    """Random positions before the outside (Sect. 4.3).

    Table 9's ranges of all features are taken as the reference feature's, and as many positions as
    give about the paper's number of observations.
    """
    return MeasuringPlan(
        name=name,
        sensor=sensor,
        side="outside",
        features=_OUTSIDE,
        reference="f3_out",  # in the middle of them; assumed
        random=(box,),
        seed=_SEED,
    )


def _small() -> MeasuringPlan:
    """Eight views of eight exposures; each sees training and test features."""
    planes = (
        replace(
            _NEAR,
            x_mm=(30.0, 90.0),
            y_mm=(0.0,),
            exposures_ms=positions.logarithmic_exposures(5, 100, 8, _COMET),
        ),
        replace(
            _MIDDLE,
            x_mm=(-100.0, 150.0),
            y_mm=(-80.0, 80.0),
            exposures_ms=positions.logarithmic_exposures(5, 150, 8, _COMET),
        ),
        replace(
            _FAR,
            x_mm=(-100.0, 200.0),
            y_mm=(0.0,),
            exposures_ms=positions.logarithmic_exposures(20, 350, 8, _COMET),
        ),
    )
    features = _TRAINING + _MORE_TRAINING + _TEST
    return _inside("small", planes, features)


def _demo() -> MeasuringPlan:
    """Return the paper's 48 views of all inside features, at every second exposure time."""
    planes = tuple(
        replace(plane, exposures_ms=plane.exposures_ms[1::2]) for plane in (_NEAR, _MIDDLE, _FAR)
    )
    return _inside("demo", planes, _TRAINING + _MORE_TRAINING + _TEST)


_SWEEP_EXPOSURES = (
    *(float(ms) for ms in range(2, 13)), 15.0, 18.0, 22.0, 26.0, 31.0, 37.0, 45.0, 54.0, 65.0, 78.0,
    93.0, 112.0, 135.0, 162.0, 194.0, 233.0, 280.0, 337.0, 404.0, 485.0, 583.0, 700.0,
)  # fmt: skip
"""Whole ms at about equal ratios."""


def _sweep() -> MeasuringPlan:
    """Random views of all holes, none of another plan, from too dark to clipped for each hole.

    The public benchmark's views (``docs/benchmark.md``): neither they nor their seed may change.
    """
    box = positions.RandomPositions(
        name="random",
        count=30,
        x_mm=(-230.0, 230.0),
        y_mm=(-200.0, 200.0),
        z_tcp_mm=(-165.0, 155.0),
        exposures_ms=_SWEEP_EXPOSURES,
    )
    holes = tuple(f"h{number:02d}" for number in range(1, 18))
    return MeasuringPlan(
        name="sweep",
        sensor=_COMET,
        features=_TRAINING + _MORE_TRAINING + _TEST + holes,
        reference="f1",
        random=(box,),
        blind_views="skip",
        seed=201,
    )


def _all_plans() -> tuple[MeasuringPlan, ...]:
    x = (_NEAR, _MIDDLE, _FAR)
    plus = _TRAINING + _MORE_TRAINING
    return (
        _inside("x-near", (_NEAR,)),
        _inside("x-middle", (_MIDDLE,)),
        _inside("x-far", (_FAR,)),
        _inside("x", x),
        _inside("x-test", x, _TEST),
        _inside("ex", x),
        _inside("ex-test", x, _TEST),
        _inside("ex-plus", x, plus),
        _inside("ex-plusplus", (*x, _FINER), plus),
        _lighting("lighting-1", "I"),
        _lighting("lighting-2", "II"),
        _lighting("lighting-3", "III"),
        _stereo("stereo-x", _TRAINING),
        _stereo("stereo-x-test", _TEST),
        _stereo("stereo-ex", _TRAINING),
        _stereo("stereo-ex-test", _TEST),
        _outside(
            "x-out",
            _COMET,
            positions.RandomPositions(
                name="random",
                count=14,
                x_mm=(-300, 258),
                y_mm=(-190, 133),
                z_tcp_mm=(-101, 134),
                exposures_ms=_FEW_EXPOSURES,
            ),
        ),
        _outside(
            "stereo-x-out",
            _VISARD,
            positions.RandomPositions(
                name="random",
                count=6,
                x_mm=(-287, 26),
                y_mm=(-146, 81),
                z_tcp_mm=(33, 146),
                exposures_ms=_STEREO_EXPOSURES,
            ),
        ),
        # All inside rows of the structured-light sensor but eX⁺⁺ and lighting, in one campaign.
        _inside("inside", x, plus + _TEST),
        _demo(),
        _small(),
        _sweep(),
    )


PLANS: Final[Mapping[str, MeasuringPlan]] = MappingProxyType(
    {plan.name: plan for plan in _all_plans()}
)
"""Measuring plans by name."""


def plan_preset(name: str) -> MeasuringPlan:
    """Return one of the named measuring plans.

    Raises
    ------
    InputError
        If there is no such plan.
    """
    plan = PLANS.get(name)
    if plan is None:
        msg = (
            f"no measuring plan is called {name!r}; there are {', '.join(PLANS)}"
            f"{did_you_mean(name, PLANS)}"
        )
        raise InputError(msg)
    return plan
