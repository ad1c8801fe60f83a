"""The simulated cell as a driver: poses, settings, and sensors that nobody made a preset of."""

import json
import pickle
from dataclasses import asdict, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from exposight.cell import ActiveSensor, ExposureRange, Projector, sensor_preset
from exposight.errors import FormatError, ImageError, InputError, SensorError
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.imaging import (
    AxisCoding,
    Fringe,
    GrayCode,
    PatternSequence,
    sequence_named_or_read,
    sequence_to_toml,
)
from exposight.measuring import measure_observations
from exposight.plans import DepthPlane, MeasuringPlan, plan_from_text, plan_preset, plan_to_toml
from exposight.twin import AlignmentErrors, SimulatedCell, SimulatedCellSettings
from exposight.twin.light import SceneTracer
from exposight.twin.part import SURFACES, ClearCoat, Surface, Zone
from exposight.twin.sensors import sensor_settings

ROUNDING = 1e-9
EXACT = AlignmentErrors(photogrammetric_mm=0, photogrammetric_deg=0)


# -- poses --------------------------------------------------------------------------------------


def test_the_reported_pose_is_the_true_one_with_the_drawn_error(sheet_plan, cell):
    driver = cell(sheet_plan)
    view = sheet_plan.views(driver.part)[0]
    reported = driver.reported_pose(view.camera_from_part, view.name)
    tcp_from_camera = sheet_plan.sensor.camera_from_tcp.inverse()
    error = (tcp_from_camera @ reported) @ (tcp_from_camera @ view.camera_from_part).inverse()
    drawn = driver.alignment(view.name)
    assert error.to_matrix() == pytest.approx(drawn.reported_from_true.to_matrix(), abs=ROUNDING)
    assert drawn.error_mm > 0


def test_a_planned_pose_and_the_same_pose_unplanned_agree(sheet_plan, cell):
    planned = cell(sheet_plan, kinematic_share={})
    view = sheet_plan.views(planned.part)[1]
    unplanned = SimulatedCell(sheet_plan.sensor, planned.settings, seed=sheet_plan.seed)
    poses = [each.reported_pose(view.camera_from_part, view.name) for each in (planned, unplanned)]
    assert poses[0].to_matrix() == pytest.approx(poses[1].to_matrix(), abs=ROUNDING)


def test_without_error_both_poses_are_one(sheet_plan, cell):
    driver = cell(sheet_plan, alignment=EXACT, kinematic_share={})
    view = sheet_plan.views(driver.part)[0]
    assert driver.reported_pose(view.camera_from_part, view.name) == view.camera_from_part
    notes = driver.alignment(view.name).notes
    assert notes == "aligned by photogrammetry, wrong by 0.000 mm and 0.0000°"


def test_the_near_views_and_no_others_are_aligned_by_kinematics():
    plan = plan_preset("x")
    turns = ((0.0, 0.0, 0.0), (0.0, 0.0, 90.0))
    plan = replace(plan, planes=(replace(plan.planes[0], turns_deg=turns), *plan.planes[1:]))
    driver = SimulatedCell.for_plan(replace(plan, blind_views="skip"))
    views = [name for plane in plan.planes for name, _ in plane.placements()]
    by_kinematics = [v for v in views if driver.alignment(v).aligned_by == "kinematics"]
    assert len(by_kinematics) == 32
    assert {name[-3:] for name in by_kinematics} == {"-t1", "-t2"}
    assert all(name.startswith("near-") for name in by_kinematics)


def test_the_cell_is_small_for_other_processes(sheet_plan, cell):
    driver = cell(sheet_plan)
    view = sheet_plan.views(driver.part)[0]
    before = driver.capture(30.0, view.camera_from_part, view=view.name)
    content = pickle.dumps(driver)
    assert len(content) < 20_000
    after = pickle.loads(content).capture(30.0, view.camera_from_part, view=view.name)
    assert np.array_equal(before.image, after.image)
    assert np.array_equal(before.cloud.points, after.cloud.points)


def test_a_turned_sheet_is_measured_where_the_plan_says(one_view, cell):
    """The image and the cloud are those of the turned sheet: the rings lie where the pose says."""
    turned = replace(one_view.planes[0], turns_deg=[(12.0, -8.0, 90.0)], exposures_ms=(60.0,))
    plan = replace(one_view, planes=(turned,))
    frame = measure_observations(plan, cell(plan, alignment=EXACT, kinematic_share={})).frame
    normal = Rotation.from_euler("xyz", (12.0, -8.0, 90.0), degrees=True).apply([0.0, 0.0, 1.0])
    observed = Rotation.from_euler("xyz", frame[["w_deg", "p_deg", "r_deg"]].to_numpy(), True)
    assert observed.apply([0.0, 0.0, 1.0]) == pytest.approx(np.tile(normal, (2, 1)), abs=1e-9)
    assert frame["r_deg"].to_list() == [0.0, 0.0]
    reference = frame.row(0, named=True)
    assert [reference[axis] for axis in ("x_mm", "y_mm", "z_mm")] == pytest.approx([-60, -30, -5])
    assert frame["p_norm"].min() > 0.9, frame


# -- settings -----------------------------------------------------------------------------------

SETTINGS = SimulatedCellSettings(
    lighting="II",
    alignment=AlignmentErrors(kinematic_max_mm=3.0),
    kinematic_share={"near": 0.5},
    finish="oil",
    surfaces={"oil": replace(SURFACES["bare"], coat=ClearCoat(alpha=0.02))},
    zones=(Zone(finish="bare", centre_mm=(1.0, 2.0, 3.0), radius_mm=4.0),),
    sensor={
        "sequence": asdict(sequence_named_or_read("board")),
        "camera": {"electrons_per_ms": 1e8},
    },
    rings_only=False,
    raw_frames=True,
)


def test_settings_survive_in_a_plans_file(sheet_plan):
    plan = replace(sheet_plan, simulated=SETTINGS.table())
    again = SimulatedCellSettings.of_plan(plan_from_text(plan_to_toml(plan)))
    assert again.table() == SETTINGS.table()
    read = sensor_settings(sheet_plan.sensor, again.sensor)
    assert read.sequence == sequence_named_or_read("board")
    assert read.camera.electrons_per_ms == 1e8
    assert SimulatedCellSettings.of_plan(replace(plan, simulated={})) == SimulatedCellSettings()


def test_a_share_of_no_view_is_noticed(sheet_plan, cell, caplog):
    cell(sheet_plan, kinematic_share={"midle": 1.0})
    assert "kinematic_share names 'midle'" in caplog.text
    assert "did you mean 'middle'" in caplog.text
    caplog.clear()
    cell(sheet_plan, kinematic_share={"middle": 1.0})
    assert not caplog.text


def test_paths_begin_at_the_plans_folder(sheet_plan, tmp_path):
    (tmp_path / "mine.toml").write_text(sequence_to_toml(sequence_named_or_read("board")))
    plan = replace(sheet_plan, simulated={"sequence": "mine.toml", "scene": "part"})
    settings = SimulatedCellSettings.of_plan(plan, tmp_path)
    assert settings.sensor["sequence"] == asdict(sequence_named_or_read("board"))
    assert settings.scene == tmp_path / "part"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"wheather": "II"}, r"plan 'sheet', \[simulated\]: key 'wheather' is unknown"),
        ({"lighting": "IV"}, "'lighting': expected 'I', 'II' or 'III', got \"IV\""),
        ({"finish": "gold"}, "finish 'gold' is not known; expected one of bare, primer"),
        ({"lighting": -0.1}, "from 0 up, got -0.1"),
        ({"lamp": 0}, "lamp must be a share of its power above 0, got 0"),
        ({"alignment": {"robot_mm": 1}}, r"alignment\.robot_mm' is unknown"),
        ({"alignment": {"kinematic_max_mm": -3}}, "kinematic_max_mm must be a number from 0 up"),
        ({"kinematic_share": {"near": 2}}, "kinematic_share of 'near' must be from 0 to 1, got 2"),
        ({"sequence": "webcam"}, "no pattern sequence 'webcam'"),
        ({"sequence": {"name": "x"}}, "sequence.projector_width' is missing"),
        ({"sequence": "board", "fringes": [1, 8]}, "exclude each other"),
        ({"sensor": {"camera": {"gain": 2}}}, r"simulated: key 'camera\.gain' is unknown"),
        ({"sensor": {"limits": {"min_modulation": 300}}}, "at most 255"),
        ({"sensor": {"max_depth_noise_mm": 0}}, "max_depth_noise_mm must be above 0 mm, got 0"),
        (
            {"sensor": {"dots": {"cell_px": 8}}},
            "has one camera and decodes patterns; leave out dots",
        ),
        ({"sensor": {"camera": {"prnu": 5}}}, "a PRNU below 0.5"),
        (
            {"sensor": {"fringes": [1, 8, 60, 1000]}},
            "1920 px along the columns cannot show 1000 periods",
        ),
        ({"sensor": {"matt_white": {"grey_levels": 300, "exposure_ms": 5}}}, "up to 255"),
        (
            {"sensor": {"matt_white": {"grey_levels": 200, "exposure_ms": 5}}},
            "says 200 grey levels above the black level, but its image clips beyond 129",
        ),
        (
            {
                "sensor": {
                    "matt_white": {"grey_levels": 100, "exposure_ms": 5},
                    "camera": {"electrons_per_ms": 1e8},
                }
            },
            "matt_white and camera.electrons_per_ms exclude each other",
        ),
    ],
)
def test_a_wrong_setting_is_named(sheet_plan, table, message):
    with pytest.raises((InputError, FormatError, SensorError), match=message):
        SimulatedCell.for_plan(replace(sheet_plan, simulated=table))


def test_another_surface_or_zone_is_another_cell(sheet_plan, cell):
    zone = Zone(finish="oil", box_mm=((0.0, 0.0, -1.0), (5.0, 5.0, 1.0)))
    oil = SETTINGS.surfaces["oil"]
    cells = [
        cell(sheet_plan, surfaces={"oil": oil}, zones=(zone,)),
        cell(sheet_plan, surfaces={"oil": replace(oil, diffuse_albedo=0.05)}, zones=(zone,)),
        cell(sheet_plan, surfaces={"oil": oil}, zones=(replace(zone, finish="paint"),)),
    ]
    assert len({each.description()["scene_sha256"] for each in cells}) == 3
    assert json.loads(json.dumps(cells[0].description())) == cells[0].description()
    assert cells[0].scene.zones == (zone,)


def test_another_finish_is_another_cell(sheet_plan, cell):
    primer, bare = (cell(sheet_plan, finish=finish) for finish in (None, "bare"))
    assert primer.description()["scene_sha256"] != bare.description()["scene_sha256"]
    assert (bare.scene.face_finish == 0).all()
    assert json.loads(json.dumps(bare.description())) == bare.description()


def test_half_the_lamp_takes_twice_the_time(one_view, cell):
    (view,) = one_view.views(cell(one_view).part)
    means = [
        cell(one_view, lamp=lamp).capture(t, view.camera_from_part, view=view.name).image.mean()
        for lamp, t in ((None, 30.0), (1.0, 30.0), (0.5, 60.0), (0.5, 30.0))
    ]
    assert means[0] == means[1]
    assert means[2] == pytest.approx(means[0], rel=0.01)
    assert means[3] < 0.9 * means[0]  # the black level stays


def test_the_part_says_on_which_finish_its_features_are(sheet_plan, cell):
    plain = cell(sheet_plan)
    assert {feature.finish for feature in plain.part.features} == {"primer"}
    h0, h1 = (plain.part.feature(name).part_from_feature.translation_mm for name in ("h0", "h1"))
    oil = SETTINGS.surfaces["oil"]
    spot = Zone(finish="oil", centre_mm=tuple(h1.tolist()), radius_mm=12.0)
    other = cell(sheet_plan, finish="bare", surfaces={"oil": oil}, zones=(spot,))
    assert np.linalg.norm(h1 - h0) > 25
    assert [other.part.feature(name).finish for name in ("h0", "h1")] == ["bare", "oil"]
    rows = measure_observations(
        replace(sheet_plan, planes=(replace(sheet_plan.planes[0], exposures_ms=(30.0,)),)), other
    ).frame
    assert set(rows.select("feature", "finish").rows()) == {("h0", "bare"), ("h1", "oil")}
    assert rows["sensor"].unique().to_list() == [sheet_plan.sensor.name]
    assert rows["part_r_deg"].is_not_null().all()


# -- any sensor ---------------------------------------------------------------------------------


def _camera(width: int, height: int, focal_px: float, *distortion: float) -> PinholeCamera:
    return PinholeCamera(
        width=width,
        height=height,
        fx=focal_px,
        fy=focal_px * 1.01,
        cx=width / 2 - 3,
        cy=height / 2 + 2,
        distortion=distortion,
    )


def _odd_sensor(n_cameras: int = 1) -> ActiveSensor:
    """Small images, lens distortion, a projector of odd size and place."""
    lamp = _camera(608, 342, 700.0, 0.03, -0.01, 0.0, 0.0005)
    second = RigidTransform.from_fanuc_wpr((60.0, 0.5, 1.0), 0.1, -1.0, 0.2)
    return ActiveSensor(
        name="odd",
        cameras=(_camera(320, 240, 560.0, -0.1, 0.05, 0.001, -0.0005),) * n_cameras,
        first_from_camera=(RigidTransform(), second)[:n_cameras],
        projector=Projector(
            camera=lamp,
            camera_from_projector=RigidTransform.from_fanuc_wpr((130, -8, 20), 1.0, -18.0, 2.0),
        ),
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, 400.0])),
        exposure=ExposureRange(min_ms=0.5, max_ms=200.0, increment_ms=0.1),
        working_distance_mm=(300.0, 520.0),
    )


def _odd_plan(sensor: ActiveSensor, exposure_ms: float, **simulated: object) -> MeasuringPlan:
    plane = DepthPlane(
        name="middle", z_tcp_mm=5.0, x_mm=(-20.0,), y_mm=(-8.0,), exposures_ms=(exposure_ms,)
    )
    return MeasuringPlan(
        name="odd",
        sensor=sensor,
        features=("h0", "h1"),
        reference="h0",
        planes=(plane,),
        simulated=simulated,
    )


def _odd_sequence(**coding: object) -> PatternSequence:
    return PatternSequence(name="odd", projector_width=608, projector_height=342, **coding)


_BITS = GrayCode(frames=tuple(range(2, 12)), code_width=1)
_GRAY_AND_FRINGES = AxisCoding(
    fringes=(Fringe(periods=32, frames=(8, 9, 10)),),
    gray_code=GrayCode(frames=tuple(range(2, 8)), code_width=19),
)
_BOTH_AXES = {
    "columns": AxisCoding(
        fringes=(
            Fringe(periods=1, frames=(0, 1, 2)),
            Fringe(periods=5, frames=(3, 4, 5)),
            Fringe(periods=23, frames=(6, 7, 8)),
        )
    ),
    "rows": AxisCoding(
        fringes=(Fringe(periods=1, frames=(9, 10, 11)), Fringe(periods=9, frames=(12, 13, 14)))
    ),
}
PATTERNS = {
    "default": {},
    "fringes": {"fringes": (1, 5, 23), "steps": 3},
    "Gray code": {
        "sequence": asdict(
            _odd_sequence(columns=AxisCoding(gray_code=_BITS), white_frame=0, black_frame=1)
        )
    },
    "Gray code and fringes": {
        "sequence": asdict(_odd_sequence(columns=_GRAY_AND_FRINGES, white_frame=0, black_frame=1))
    },
    "columns and rows": {"sequence": asdict(_odd_sequence(**_BOTH_AXES))},
}


@pytest.mark.parametrize("patterns", PATTERNS)
def test_a_sensor_of_ones_own_sees_its_rings_whole(cell, patterns):
    plan = _odd_plan(_odd_sensor(), 40.0)
    driver = cell(plan, rings_only=False, sensor=PATTERNS[patterns])
    table = measure_observations(plan, driver)
    p_norm, i_avg = table.array(["p_norm", "i_avg"]).T
    assert p_norm == pytest.approx(1.0, abs=0.06), (p_norm, i_avg)
    view = plan.views(driver.part)[0]
    cloud = driver.capture(40.0, view.camera_from_part, view=view.name).cloud
    points = view.camera_from_part.inverse().apply(cloud.valid_points)
    on_sheet = np.abs(points[:, :2]).max(axis=1) < 40
    assert np.median(np.abs(points[on_sheet, 2])) < 0.4  # the sheet's front is z = 0


def test_rings_only_give_the_same_with_ones_own_fringes(cell):
    plan = _odd_plan(_odd_sensor(), 40.0)
    tables = [
        measure_observations(
            plan, cell(plan, rings_only=rings_only, sensor={"fringes": (1, 5, 23)})
        ).frame
        for rings_only in (False, True)
    ]
    assert tables[0].equals(tables[1])


def test_a_stereo_sensor_of_ones_own_sees_its_rings(cell):
    plan = _odd_plan(_odd_sensor(2), 3.0)
    table = measure_observations(plan, cell(plan, rings_only=False))
    assert table.frame["p_norm"].min() > 0.8, table.frame


def test_what_a_sensor_cannot_do_is_said(cell):
    plan, stereo = _odd_plan(_odd_sensor(), 5.0), _odd_plan(_odd_sensor(2), 5.0)
    with pytest.raises(SensorError, match="'odd' has no projector"):
        cell(replace(plan, sensor=replace(plan.sensor, projector=None)))
    with pytest.raises(SensorError, match="608 × 342 px, the stripes 1024 × 768"):
        cell(plan, sensor={"sequence": "board"})
    with pytest.raises(InputError, match="'odd' decodes Gray code in whole images"):
        cell(plan, sensor=PATTERNS["Gray code"])
    with pytest.raises(InputError, match="'odd' matches whole images"):
        cell(stereo)
    with pytest.raises(InputError, match="match dots; leave out fringes"):
        cell(stereo, sensor={"fringes": (1, 8)}, rings_only=False)
    with pytest.raises(ImageError, match="repeat every 304 px of 608"):
        cell(plan, sensor={"fringes": (2, 8)})
    deep = {**PATTERNS["columns and rows"]["sequence"], "bit_depth": 12}
    assert cell(plan, sensor={"sequence": deep})._model.electronics.bit_depth == 12
    with pytest.raises(SensorError, match="the camera has 10 bits, the sequence 12"):
        cell(plan, sensor={"sequence": deep, "camera": {"bit_depth": 10}})


def test_a_sensors_document_carries_its_table_and_a_plan_overrides_it(cell):
    table = {"camera": {"full_well_e": 20_000.0, "read_noise_e": 5.0}, "fringes": [1, 5, 23]}
    sensor = ActiveSensor.from_json(replace(_odd_sensor(), simulated=table).to_json())
    plan = _odd_plan(sensor, 40.0)
    given = {"camera": {"read_noise_e": 7.0}, "image": "first"}
    model = cell(plan, sensor=given)._model
    electronics = model.electronics
    assert (electronics.full_well_e, electronics.read_noise_e) == (20_000.0, 7.0)
    assert [fringe.periods for fringe in model.sequence.columns.fringes] == [1, 5, 23]
    assert model.image == "first"


@pytest.mark.parametrize("n_cameras", [1, 2])
def test_matt_white_at_the_tcp_is_as_bright_as_said(plate, n_cameras):
    white = {"matt_white": {"grey_levels": 90.0, "exposure_ms": 12.0}}
    sensor = replace(_odd_sensor(n_cameras), simulated=white)
    model = SimulatedCell(sensor)._model
    matt = Surface(
        diffuse_albedo=0.9,
        mirror_reflectance=0.0,
        alpha_along=0.5,
        alpha_across=0.5,
        grain_contrast=0.0,
        normal_noise_rad=0.0,
    )
    scene = replace(plate("primer", step_mm=10.0), surfaces=dict(SURFACES, primer=matt))
    light = model.look(SceneTracer(scene), sensor.camera_from_tcp)
    image = model.capture(light, 12.0, view="v", seed=(1,)).image
    middle = image[90:150, 120:190]
    assert middle.mean() == pytest.approx(10.0 + 0.9 * 90.0, rel=0.03)


def test_the_presets_are_simulated_as_before():
    """The light of the paper's sensors does not depend on how others are scaled."""
    for name, defocus in (("comet-pro-ae", 3000.0), ("rc-visard-65", 1123.0)):
        model = SimulatedCell(sensor_preset(name))._model
        assert model.light.projector.defocus_px_mm == defocus
