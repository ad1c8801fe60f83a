"""The light of a view, against closed forms and against its own parts."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import sensor_preset
from exposight.errors import InputError, SensorError
from exposight.geometry import PixelBox, RigidTransform
from exposight.twin.light import (
    CameraLens,
    LightModel,
    ProjectorLens,
    SceneTracer,
    ambient_share,
    trace_view,
)
from exposight.twin.light.view_light import disjoint_boxes
from exposight.twin.part import FINISHES, SURFACES, Scene, Surface, Zone
from exposight.twin.part.reflectance import reflectance

MATT = Surface(
    diffuse_albedo=0.5,
    mirror_reflectance=0.0,
    alpha_along=0.5,
    alpha_across=0.5,
    grain_contrast=0.0,
    normal_noise_rad=0.0,
)
"""Next to Lambertian: Schlick's term alone rises towards grazing light."""
FLAT_LENS = CameraLens(spread_px=0.0, vignetting_exponent=0.0)
BOX = PixelBox(top=130, bottom=170, left=180, right=230)

SINGLE = 2e-3
"""mm at 600 mm: rounding of Embree's single precision, several times over."""


def _matt_model(**change: object) -> LightModel:
    return LightModel(camera=FLAT_LENS, **{"indirect": False, **change})


def _tracer(scene: Scene, primer: Surface = MATT) -> SceneTracer:
    return SceneTracer(replace(scene, surfaces={**SURFACES, "primer": primer}))


def test_radiance_of_a_matt_sheet_has_its_closed_form(plate, small_sensor, before) -> None:
    pose = before()
    view = trace_view(_tracer(plate("primer")), small_sensor, pose, model=_matt_model())
    tile = view.tiles[0]
    rays = small_sensor.camera.rays()[::37, ::41]
    normal = pose.rotation @ [0.0, 0.0, -1.0]
    depth = (normal @ pose.translation_mm) / (rays @ normal[:2] + normal[2])
    points = np.concatenate([rays * depth[..., None], depth[..., None]], axis=-1)
    seen = np.isfinite(tile.depth_mm[::37, ::41])
    assert seen.sum() > 20
    lamp = small_sensor.projector.camera_from_projector
    to_lamp = lamp.translation_mm - points
    r = np.linalg.norm(to_lamp, axis=-1)
    cos_i = to_lamp @ normal / r
    cos_p = lamp.inverse().apply(points)[..., 2] / r
    expected = 0.5 / np.pi * cos_i / (r**2 * cos_p**3)
    # Schlick's term with F₀ = 0 adds less than 10⁻⁴ at these angles.
    assert tile.direct[::37, ::41][seen] == pytest.approx(expected[seen], rel=1e-3)


def test_true_depth_is_that_of_the_sheet(plate, small_sensor, before) -> None:
    pose = before()
    view = trace_view(_tracer(plate("primer")), small_sensor, pose, model=_matt_model())
    depth = view.tiles[0].depth_mm
    rows, columns = np.nonzero(np.isfinite(depth))
    pixels = np.stack([columns, rows], axis=-1)
    points = small_sensor.camera.back_project(pixels, depth[rows, columns])
    assert np.abs(pose.inverse().apply(points)[:, 2]).max() < SINGLE


def test_pattern_coordinates_are_the_projections_of_the_points(
    plate, small_sensor, before, with_lens
) -> None:
    sensor = with_lens(small_sensor)
    view = trace_view(_tracer(plate("primer")), sensor, before(), model=_matt_model())
    tile = view.tiles[0]
    rows, columns = np.nonzero(tile.direct)
    points = sensor.camera.back_project(
        np.stack([columns, rows], axis=-1), tile.depth_mm[rows, columns]
    )
    lamp = sensor.projector
    uv = lamp.camera.project(lamp.camera_from_projector.inverse().apply(points))
    assert np.abs(tile.column[rows, columns] - uv[:, 0]).max() < 2e-3  # float32 of 1920 px
    assert np.abs(tile.row[rows, columns] - uv[:, 1]).max() < 2e-3


def test_a_wall_throws_a_shadow_where_geometry_says(plate, small_sensor) -> None:
    pose = RigidTransform(translation_mm=np.array([0.0, 0.0, 600.0]))
    # The projector stands at x = +234: behind a wall at x = 20 of 50 mm lies its shadow.
    tracer = _tracer(plate("primer", wall_at_mm=20.0))
    tile = trace_view(tracer, small_sensor, pose, model=_matt_model()).tiles[0]
    lamp_x, _, lamp_z = small_sensor.projector.camera_from_projector.translation_mm - (0, 0, 600.0)
    reach = 20.0 - (lamp_x - 20.0) * 50.0 / (-50.0 - lamp_z)  # where the ray over its edge lands
    x = small_sensor.camera.rays()[150, :, 0] * 600.0
    on_sheet = np.abs(tile.depth_mm[150] - 600.0) < 0.1
    dark = tile.direct[150] == 0.0
    assert dark[on_sheet & (x > reach + 0.5) & (x < 19.0)].all()
    assert not dark[on_sheet & (x < reach - 0.5)].any()


def test_nothing_is_lit_outside_the_pattern(plate, small_sensor, before) -> None:
    lamp = small_sensor.projector
    narrow = replace(lamp, camera=replace(lamp.camera, fx=20000.0, fy=20000.0))
    sensor = replace(small_sensor, projector=narrow)
    tile = trace_view(_tracer(plate("primer")), sensor, before(), model=_matt_model()).tiles[0]
    lit = tile.direct > 0
    assert 0 < lit.sum() < np.isfinite(tile.depth_mm).sum()
    assert tile.row[lit].min() >= -0.5
    assert tile.row[lit].max() < 1199.5


def test_two_views_of_one_spot_see_the_same_grain(plate, small_sensor) -> None:
    grainy = replace(MATT, grain_contrast=0.5)
    model, tracer, even_tracer = (
        _matt_model(),
        _tracer(plate("primer"), grainy),
        _tracer(plate("primer")),
    )
    step = 20 * 600.0 / small_sensor.camera.fx  # moves the image by 20 px
    ratios = []
    for x in (0.0, step):
        pose = RigidTransform(translation_mm=np.array([x, 0.0, 600.0]))
        seen = trace_view(tracer, small_sensor, pose, model=model).tiles[0].direct
        even = trace_view(even_tracer, small_sensor, pose, model=model).tiles[0].direct
        ratios.append(seen / np.where(even > 0, even, 1.0))
    here, there = ratios[0][130:170, 150:220], ratios[1][130:170, 170:240]
    assert here.std() > 0.05
    assert np.abs(here - there).max() < 1e-3


def test_boxes_have_the_very_light_of_the_whole_frame(plate, small_sensor, before) -> None:
    tracer = SceneTracer(plate("bare", ((0.0, 0.0, 8.0),), wall_at_mm=-25.0))
    pose = before()
    whole = trace_view(tracer, small_sensor, pose).tiles[0]
    tile = trace_view(tracer, small_sensor, pose, boxes=[BOX]).tiles[0]
    t = tile.traced
    cut = (slice(t.top, t.bottom), slice(t.left, t.right))
    for name in ("direct", "column", "row", "blur_px", "indirect", "ambient", "depth_mm"):
        expected = getattr(whole, name)[..., cut[0], cut[1]]
        assert np.array_equal(getattr(tile, name), expected, equal_nan=True), name
    assert tile.indirect.max() > 0


def test_a_spot_inside_a_triangle_changes_nothing_outside(plate, small_sensor, before) -> None:
    scene = plate("primer", step_mm=90.0)  # four large triangles
    spot = Zone(finish="paint", centre_mm=(3.0, -2.0, 0.0), radius_mm=6.0)
    clean, spotted = (
        trace_view(SceneTracer(each), small_sensor, before(), model=_matt_model()).tiles[0]
        for each in (scene, replace(scene, zones=(spot,)))
    )
    rows, columns = np.nonzero(np.isfinite(clean.depth_mm))
    points = (
        before()
        .inverse()
        .apply(
            small_sensor.camera.back_project(
                np.stack([columns, rows], axis=-1), clean.depth_mm[rows, columns]
            )
        )
    )
    off = np.linalg.norm(points - spot.centre_mm, axis=1) - spot.radius_mm
    for name in ("direct", "ambient"):
        differs = (getattr(clean, name) != getattr(spotted, name))[rows, columns]
        assert not differs[off > SINGLE].any()
        assert differs[(off < -SINGLE) & (clean.direct[rows, columns] > 0)].all()
    assert (off < -SINGLE).sum() > 100


def test_overlapping_boxes_are_joined() -> None:
    boxes = [
        PixelBox(top=0, bottom=10, left=0, right=10),
        PixelBox(top=20, bottom=30, left=0, right=10),
        PixelBox(top=5, bottom=25, left=8, right=12),
        PixelBox(top=0, bottom=5, left=50, right=60),
        PixelBox(top=3, bottom=3, left=0, right=100),
    ]
    assert disjoint_boxes(boxes) == [
        PixelBox(top=0, bottom=30, left=0, right=12),
        PixelBox(top=0, bottom=5, left=50, right=60),
    ]


def test_one_bounce_agrees_with_an_integral_over_the_wall(plate, small_sensor) -> None:
    """G = ∫ f_r · L · cosθ · cosθ' / d² dA over the wall, L = f_r' · E of the projector."""
    pose = RigidTransform(translation_mm=np.array([0.0, 0.0, 600.0]))
    tracer = _tracer(plate("primer", wall_at_mm=-25.0))  # faces +x, towards the projector
    model = _matt_model(indirect=True)
    view = trace_view(tracer, small_sensor, pose, model=model)
    row = tracer.surfaces[FINISHES.index("primer")]
    y, z = np.meshgrid(np.arange(-42.0, 45.0, 6.0), -np.arange(2.5, 50.0, 5.0), indexing="ij")
    wall = np.stack([np.full_like(y, -25.0), y, z], axis=-1).reshape(-1, 3)
    lamp = pose.inverse() @ small_sensor.projector.camera_from_projector
    to_lamp = lamp.translation_mm - wall
    r = np.linalg.norm(to_lamp, axis=1)
    cos_p = lamp.inverse().apply(wall)[:, 2] / r
    lit = to_lamp[:, 0] / r / (r**2 * cos_p**3) * 6.0 * 5.0
    traced, expected = [], []
    for i in range(100, 201, 10):
        for j in range(180, 301, 10):
            point = np.array([*(small_sensor.camera.rays()[i, j] * 600.0), 0.0])
            away = point - wall
            d = np.linalg.norm(away, axis=1)
            away /= d[:, None]
            eye = point - [0.0, 0.0, -600.0]
            to_eye = tuple(-eye / np.linalg.norm(eye))
            total = 0.0
            for k in range(len(wall)):
                on_wall = reflectance(
                    row, (1.0, 0.0, 0.0), tuple(to_lamp[k] / r[k]), tuple(away[k])
                )
                on_sheet = reflectance(row, (0.0, 0.0, -1.0), tuple(-away[k]), to_eye)
                total += on_sheet * on_wall * lit[k] * away[k, 0] * away[k, 2] / d[k] ** 2
            traced.append(view.tiles[0].indirect[i, j])
            expected.append(total)
    # Each of 143 places averages 25 nodes of 16 rays, of which a tenth meet the wall: 15 % each,
    # and neighbours share nodes, so that some 40 of them are independent.
    assert sum(traced) == pytest.approx(sum(expected), rel=0.05)


def test_a_lone_sheet_has_no_bounce(plate, small_sensor, before) -> None:
    view = trace_view(SceneTracer(plate("primer")), small_sensor, before(), boxes=[BOX])
    assert view.tiles[0].indirect.max() == 0.0


@pytest.mark.parametrize("lighting", ["I", "II", "III"])
def test_ambient_light_is_a_share_of_the_projectors(plate, small_sensor, lighting) -> None:
    pose = small_sensor.camera_from_tcp
    model = _matt_model(lighting=lighting)
    view = trace_view(_tracer(plate("primer")), small_sensor, pose, model=model, boxes=[BOX])
    tile = view.tiles[0]
    # At the TCP a square sheet gets the cosine of the projector's angle of its full light.
    lamp = small_sensor.projector.camera_from_projector
    to_lamp = lamp.translation_mm - pose.translation_mm
    cosine = -to_lamp[2] / np.linalg.norm(to_lamp)
    middle = (20 + 2, 20 + 2)
    share = tile.ambient[middle] / tile.direct[middle] * cosine
    assert share == pytest.approx(ambient_share(lighting), rel=0.01)


def test_the_lens_dims_the_borders_by_cos_to_the_fourth(plate, small_sensor, before) -> None:
    tracer = _tracer(plate("primer"))
    seen = []
    for exponent in (0.0, 4.0):
        model = LightModel(camera=CameraLens(vignetting_exponent=exponent), indirect=False)
        seen.append(trace_view(tracer, small_sensor, before(), model=model).tiles[0].direct)
    lit = seen[0] > 0
    square = 1 + (small_sensor.camera.rays() ** 2).sum(axis=-1)
    assert seen[1][lit] / seen[0][lit] == pytest.approx(square[lit] ** -2, rel=1e-5)


def test_blur_is_least_at_the_tcp(plate, small_sensor) -> None:
    tracer = _tracer(plate("primer"))
    blurs = []
    for z in (450.0, 600.0, 750.0):
        pose = RigidTransform(translation_mm=np.array([0.0, 0.0, z]))
        tile = trace_view(tracer, small_sensor, pose, boxes=[BOX], model=_matt_model()).tiles[0]
        blurs.append(tile.blur_px[20, 20])
    assert blurs[1] == pytest.approx(ProjectorLens().sharp_blur_px, abs=0.02)
    assert blurs[0] > blurs[2] > 1.0


def test_a_lens_that_reaches_no_ray_sees_nothing_there(plate, small_sensor, before) -> None:
    # Strong barrel distortion folds over before the corners.
    camera = replace(small_sensor.camera, fx=300.0, fy=300.0, distortion=(-0.6, 0.0, 0.0, 0.0))
    sensor = replace(small_sensor, cameras=(camera,))
    assert np.isnan(camera.rays()).any()
    tile = trace_view(SceneTracer(plate("primer")), sensor, before()).tiles[0]
    blind = np.isnan(camera.rays()[..., 0])
    assert np.isnan(tile.depth_mm[blind]).all()
    assert (tile.direct[blind] == 0).all()


def test_the_second_camera_sees_the_sheet_from_its_own_place(plate) -> None:
    sensor = sensor_preset("rc-visard-65")
    tracer = _tracer(plate("primer"))
    pose = RigidTransform(translation_mm=np.array([0.0, 0.0, 500.0]))
    left, right = (
        trace_view(tracer, sensor, pose, model=_matt_model(), camera_index=i) for i in (0, 1)
    )
    disparity = 65.0 * sensor.camera.fx / 500.0
    edges = [np.flatnonzero(np.isfinite(v.tiles[0].depth_mm[480]))[0] for v in (left, right)]
    assert edges[0] - edges[1] == pytest.approx(disparity, abs=1.0)


def test_a_view_that_sees_nothing_is_refused(plate, small_sensor) -> None:
    aside = RigidTransform(translation_mm=np.array([5000.0, 0.0, 600.0]))
    with pytest.raises(InputError, match="sees nothing of the part"):
        trace_view(SceneTracer(plate("primer")), small_sensor, aside)


def test_a_sensor_without_projector_is_refused(plate, small_sensor, before) -> None:
    with pytest.raises(SensorError, match="has no projector"):
        trace_view(SceneTracer(plate("primer")), replace(small_sensor, projector=None), before())


def test_impossible_lenses_are_refused() -> None:
    with pytest.raises(SensorError, match=r"a spread from 0 to 0\.8 px"):
        CameraLens(spread_px=2.0)
    with pytest.raises(SensorError, match="contrast above 0 and up to 1"):
        ProjectorLens(contrast=0.0)
