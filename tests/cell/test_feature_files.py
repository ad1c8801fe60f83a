from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from exposight.cell import RULES, Feature, read_features
from exposight.cell.feature_lists.feature_files import features_from_csv, features_to_csv
from exposight.errors import FeatureError, FormatError, MissingFileError
from exposight.geometry import RigidTransform

HEADER = "name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm"
FULL = HEADER + ",length_mm,width_mm,tx,ty,tz"

POSE_TOLERANCE = 1e-12
"""A rotation is written as two axes and made orthonormal again: a few roundings of 1e-16."""


def read(tmp_path, text):
    path = tmp_path / "features.csv"
    path.write_text(text, encoding="utf-8")
    return read_features(path)


sizes = st.floats(1e-3, 1e3)
angles = st.floats(-180, 180)
names = st.text(
    st.characters(exclude_categories=("C", "Z"), include_characters=" "), min_size=1
).filter(lambda name: name == name.strip() and name)


@st.composite
def features(draw):
    kind = draw(st.sampled_from(sorted(RULES)))
    radius, length = draw(sizes), None
    if RULES[kind].has_length:
        length = 2 * radius + draw(sizes)
    rotation = Rotation.from_euler("xyz", draw(st.tuples(angles, angles, angles)), degrees=True)
    position = draw(st.tuples(*[st.floats(-1e4, 1e4)] * 3))
    return Feature(
        name=draw(names),
        kind=kind,
        part_from_feature=RigidTransform(
            rotation=rotation.as_matrix(), translation_mm=np.array(position)
        ),
        radius_mm=radius,
        length_mm=length,
        width_mm=None if length is None else 2 * radius,
    )


@settings(max_examples=40, deadline=None)
@given(written=st.lists(features(), min_size=1, max_size=4, unique_by=lambda f: f.name))
def test_writing_and_reading_is_the_identity(written):
    """As campaigns keep their features, at whatever places."""
    found = features_from_csv(features_to_csv(written), Path("features.csv"))
    sizes = [
        [(f.name, f.kind, f.radius_mm, f.length_mm, f.width_mm) for f in fs]
        for fs in (found, written)
    ]
    assert sizes[0] == sizes[1]
    for one, other in zip(found, written, strict=True):
        np.testing.assert_array_equal(
            one.part_from_feature.translation_mm, other.part_from_feature.translation_mm
        )
        np.testing.assert_allclose(
            one.part_from_feature.rotation, other.part_from_feature.rotation, atol=POSE_TOLERANCE
        )


def test_the_outward_normal_is_turned_into_the_material(tmp_path):
    (hole,) = read(tmp_path, f"{HEADER}\nf1,hole,1,2,3,0,0,1,6\n")
    assert hole.part_from_feature.z_axis.tolist() == [0, 0, -1]
    assert hole.part_from_feature.translation_mm.tolist() == [1, 2, 3]


def test_the_direction_of_the_length_becomes_the_x_axis(tmp_path):
    (slot,) = read(tmp_path, f"{FULL}\ns1,slot,0,0,0,0,0,1,4,20,8,0,1,0\n")
    assert slot.part_from_feature.rotation[:, 0].tolist() == [0, 1, 0]
    assert np.linalg.det(slot.part_from_feature.rotation) == pytest.approx(1)


def test_a_file_of_a_spreadsheet_is_read(tmp_path):
    text = f"\ufeff{HEADER}\r\n f1 , hole,1,2,3,0,0,1,6\r\n\r\n,,,,,,,,\r\n"
    assert [feature.name for feature in read(tmp_path, text)] == ["f1"]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no feature list at .*gone\.csv"):
        read_features(tmp_path / "gone.csv")


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (HEADER.replace(",x_mm", ",foo"), r"missing column x_mm \(its columns are 'name', 'kind'"),
        (HEADER.replace(",radius_mm", ",foo"), "missing column radius_mm, or diameter_mm"),
        (
            "name,kind,x_mm,y_mm,z_mm,a,b,c,radius_mm",
            "missing columns nx, ny, nz.* no normals: add",
        ),
        (HEADER.replace("y_mm", "x"), "'x_mm' and 'x' are both x_mm: leave one out"),
        ("", "expected a line with the columns' names"),
    ],
)
def test_a_header_that_lacks_something_is_refused(tmp_path, header, message):
    with pytest.raises(FormatError, match=message):
        read(tmp_path, f"{header}\nf1,hole,1,2,3,0,0,1,6\n")


@pytest.mark.parametrize(
    ("row", "error", "message"),
    [
        ("f1,hole,1,nan,3,0,0,1,6", FeatureError, "'f1': column y_mm: expected a finite number"),
        ("f1,hole,1,2,3,0,0,1,NaN", FeatureError, "'f1': column radius_mm: .* got 'NaN'"),
        ("f1,hole,1,2,3,0,0,1,6mm", FormatError, "column radius_mm: expected a number, got '6mm'"),
        ("f1,hole,1,,3,0,0,1,6", FormatError, "column y_mm: expected a number, got ''"),
        ("f1,hole,1,2,3,0,0,1", FormatError, "row 2: expected 9 cells, got 8"),
        ("f1,hole,1,2,3,0,0,1,0", FeatureError, "'f1': the radius of a hole must be above 0 mm"),
        ("f1,screw,1,2,3,0,0,1,6", FeatureError, "kind must be one of .*, got 'screw'"),
        ("f1,hole,1,2,3,0,0,0,6", FeatureError, r"normal \(nx, ny, nz\) must have length 1, got 0"),
        ("f1,hole,1,2,3,9,8,7,6", FeatureError, "must have length 1, got 13"),
        ("f1,slot,1,2,3,0,0,1,6", FeatureError, "needs the direction of its length"),
    ],
)
def test_a_bad_row_is_named(tmp_path, row, error, message):
    with pytest.raises(error, match=message) as caught:
        read(tmp_path, f"{HEADER}\n{row}\n")
    assert "features.csv, row 2" in str(caught.value)


def test_a_length_that_leaves_the_surface_is_refused(tmp_path):
    with pytest.raises(FeatureError, match="must lie in the surface, at right angles"):
        read(tmp_path, f"{FULL}\ns1,slot,0,0,0,0,0,1,4,20,8,0,1,0.2\n")


def test_names_that_are_there_twice_are_named(tmp_path):
    row = "f1,hole,1,2,3,0,0,1,6\n"
    with pytest.raises(FeatureError, match=r"features\.csv: feature 'f1' is there twice"):
        read(tmp_path, f"{HEADER}\n{row}{row}")


def test_a_list_without_features_is_refused(tmp_path):
    with pytest.raises(FeatureError, match="lists no feature"):
        read(tmp_path, HEADER)


def test_finishes_come_back_and_are_left_out_where_none_is_known(part):
    text = features_to_csv(part.features)
    assert "finish" not in text
    known = (replace(part.features[0], finish="primer"), *part.features[1:])
    text = features_to_csv(known)
    assert text.splitlines()[0].endswith(",tz,finish")
    again = features_from_csv(text, Path("features.csv"))
    assert [feature.finish for feature in again] == ["primer", "", ""]


@pytest.mark.parametrize("finish", [" bare", "bare "])
def test_a_finish_is_a_name(part, finish):
    with pytest.raises(FeatureError, match="its finish must be a name"):
        replace(part.features[0], finish=finish)
