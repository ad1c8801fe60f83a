"""Which finish is where: names, colours of triangles, boxes and balls."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import FormatError, InputError
from exposight.files import validate
from exposight.twin.part import FINISHES, SURFACES, ClearCoat, Finishes, Scene, Zone
from exposight.twin.part.finishes import finish_at, zone_table

MESH = np.array([0, 1, 2, 3, 0], dtype=np.uint8)
COLOURS = np.array(
    [[255, 0, 0, 255], [255, 0, 0, 255], [0, 0, 255, 255], [30, 144, 255, 255], [0] * 4]
)
LACQUER = replace(SURFACES["primer"], coat=ClearCoat(alpha=0.05))
SPOT = Zone(finish="oil", centre_mm=(1.0, 2.0, 3.0), radius_mm=2.0)


def _names(finishes: Finishes, colours: np.ndarray | None = None) -> list[str]:
    numbers, surfaces = finishes.of_faces(MESH, face_colours=colours)
    return [tuple(surfaces)[number] for number in numbers]


def test_a_document_that_says_nothing_leaves_the_mesh_as_it_is() -> None:
    assert _names(Finishes()) == ["bare", "primer", "paint", "brushed", "bare"]


def test_colours_go_over_the_finish_of_the_whole_part() -> None:
    finishes = Finishes(
        surfaces={"lacquer": LACQUER},
        finish="primer",
        colours={"#FF0000": "lacquer", "#0000ff": "bare"},
    )
    assert _names(finishes, COLOURS) == ["lacquer", "lacquer", "bare", "primer", "primer"]


def test_a_surface_of_a_known_name_takes_its_place() -> None:
    numbers, surfaces = Finishes(surfaces={"primer": LACQUER}).of_faces(MESH)
    assert np.array_equal(numbers, MESH)
    assert tuple(surfaces) == FINISHES
    assert surfaces["primer"] == LACQUER
    assert surfaces["bare"] == SURFACES["bare"]


@pytest.mark.parametrize(
    ("finishes", "message"),
    [
        (Finishes(finish="prime"), "'prime' is not known; did you mean 'primer'?"),
        (Finishes(colours={"#ff0000": "oil"}), "'oil' is not known"),
        (Finishes(zones=(SPOT,)), "'oil' is not known"),
        (Finishes(colours={"#1e90fe": "bare"}), "'#1e90fe'; did you mean '#1e90ff'?"),
    ],
)
def test_names_and_colours_that_are_not_there_are_refused(finishes: Finishes, message: str) -> None:
    with pytest.raises(InputError) as caught:
        finishes.of_faces(MESH, face_colours=COLOURS)
    assert message in str(caught.value)


def test_colours_need_a_coloured_mesh() -> None:
    with pytest.raises(InputError, match="triangles of the mesh have no colours"):
        Finishes(colours={"#ff0000": "bare"}).of_faces(MESH)


def test_a_colour_is_written_in_one_way() -> None:
    with pytest.raises(InputError, match="'#rrggbb', such as '#1e90ff', got 'red'"):
        Finishes(colours={"red": "bare"})


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "needs either box_mm"),
        ({"radius_mm": 3}, "needs either box_mm"),
        ({"box_mm": [[0, 0, 0], [1, 1, 1]], "radius_mm": 3}, "needs either box_mm"),
        ({"box_mm": [[0, 0, 0], [1, 0, 1]]}, "from its least to its greatest"),
        ({"centre_mm": [0, 0, 0], "radius_mm": 0}, "a radius above 0"),
        ({"centre_mm": [0, 0], "radius_mm": 1}, r"zones\[0\]\.centre_mm"),
        ({"center_mm": [0, 0, 0], "radius_mm": 1}, "'zones.*center_mm' is unknown"),
    ],
)
def test_a_zone_that_is_none_is_refused(table: dict[str, object], message: str) -> None:
    with pytest.raises(FormatError, match=message):
        validate(Finishes, {"zones": [{"finish": "bare", **table}]}, "scene.toml")


def test_a_document_survives_its_table() -> None:
    finishes = Finishes(
        surfaces={"oil": LACQUER, "across": replace(LACQUER, brushed_along=(0.0, 1.0, 0.0))},
        finish="oil",
        colours={"#ff0000": "bare"},
        zones=(SPOT, Zone(finish="bare", box_mm=((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)))),
    )
    assert validate(Finishes, finishes.table(), "") == finishes
    assert Finishes().table() == {}


coordinate = st.floats(-10, 10)
point = st.tuples(coordinate, coordinate, coordinate)
ball = st.builds(
    lambda finish, centre, radius: Zone(finish=finish, centre_mm=centre, radius_mm=radius),
    st.sampled_from(FINISHES),
    point,
    st.floats(0.5, 12),
)
box = st.builds(
    lambda finish, corner, size: Zone(
        finish=finish,
        box_mm=(corner, (corner[0] + size[0], corner[1] + size[1], corner[2] + size[2])),
    ),
    st.sampled_from(FINISHES),
    point,
    st.tuples(*[st.floats(0.5, 12)] * 3),
)


@settings(deadline=None)  # the first call compiles
@given(st.lists(ball | box, max_size=4), point)
def test_the_last_zone_round_a_point_counts(zones: list[Zone], at: tuple[float, ...]) -> None:
    expected = 7
    for zone in zones:
        if zone.box_mm is not None:
            inside = all(
                a <= x <= b for a, x, b in zip(zone.box_mm[0], at, zone.box_mm[1], strict=True)
            )
        else:
            offset = np.subtract(at, zone.centre_mm)
            inside = (offset**2).sum() <= zone.radius_mm**2
        if inside:
            expected = FINISHES.index(zone.finish)
    assert finish_at(zone_table(zones, FINISHES), at, 7) == expected


def test_a_finish_of_the_whole_part_goes_over_a_scenes_zones(plate) -> None:
    def spotted(scene: Scene) -> Scene:
        return scene.with_finishes(Finishes(surfaces={"oil": LACQUER}, zones=(SPOT,)))

    scene = spotted(plate("bare"))
    assert scene.zones == (SPOT,)
    again = scene.with_finishes(Finishes(zones=(replace(SPOT, finish="paint"),)))
    assert [zone.finish for zone in again.zones] == ["oil", "paint"]
    whole = scene.with_finishes(Finishes(finish="oil"))
    assert whole.zones == ()
    assert (whole.face_finish == 4).all()


def test_a_scenes_zones_have_finishes_that_it_knows(plate) -> None:
    with pytest.raises(InputError, match="'oil' is not known"):
        replace(plate("bare"), zones=(SPOT,))
