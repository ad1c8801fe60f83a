import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.cell import RULES, read_features
from exposight.cell.feature_lists.feature_files import features_to_csv
from exposight.cell.feature_lists.feature_words import kind_of
from exposight.errors import AmbiguousError, FeatureError, FormatError
from exposight.files import Reading, collected_remarks, reading_as

HOLES = [("H1", -62.5, -41.25, 0.5, 6.25), ("H2", 51.75, -44.5, 0.25, 8.5)]
GERMAN = "Merkmal;Art;X [mm];Y [mm];Z [mm];I;J;K;Ø [mm];Bemerkung\n" + "".join(
    f"{n};Bohrung;{x};{y};{z};0;0;1;{2 * r};siehe Zeichnung\n".replace(".", ",")
    for n, x, y, z, r in HOLES
)


def read(tmp_path, text, encoding="utf-8", **reading):
    path = tmp_path / "list.csv"
    path.write_bytes(text.encode(encoding))
    return read_features(path, reading=Reading(**reading))


def facts(features):
    """Return of each feature its place, radius and outward normal."""
    return [
        [*f.part_from_feature.translation_mm, f.radius_mm, *(0.0 - f.part_from_feature.z_axis)]
        for f in features
    ]


def listed(header, row, **numbers):
    """Return a table of the two holes."""
    lines = [row.format(n=n, x=x, y=y, z=z, r=r, d=2 * r, **numbers) for n, x, y, z, r in HOLES]
    return "\n".join([header, *lines]) + "\n"


TRUTH = [[x, y, z, r, 0, 0, 1] for _, x, y, z, r in HOLES]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_a_german_excel_list_is_read_and_said(tmp_path, encoding):
    with collected_remarks() as remarks:
        features = read(tmp_path, GERMAN, encoding)
    np.testing.assert_allclose(facts(features), TRUTH)
    assert [f.name for f in features] == ["H1", "H2"]
    said = "".join(remarks)
    assert "decimal commas" in said
    assert "Bohrung is hole" in said
    assert "halved to radius_mm" in said
    assert "not read: Bemerkung" in said


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("radius_mm,nz,ny,nx,z_mm,y_mm,x_mm,kind,name", "{r},1,0,0,{z},{y},{x},hole,{n}"),
        ("Feature,Type,X,Y,Z,I,J,K,R", "{n},circle,{x},{y},{z},0,0,1,{r}"),
        ("Name,Pos X,Pos Y,Pos Z,Normal X,Normal Y,Normal Z,Dia", "{n},{x},{y},{z},0,0,1,{d}"),
        ("id\tx (mm)\ty (mm)\tz (mm)\tnx\tny\tnz\tRadius [mm]", "{n}\t{x}\t{y}\t{z}\t0\t0\t1\t{r}"),
        (
            "ID,Name,Type,x_mm,y_mm,z_mm,nx,ny,nz,Durchmesser [mm],Tiefe",
            "7,{n},Kreis,{x},{y},{z},0,0,1,{d},3",
        ),
        ("name,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm,diameter_mm", "{n},{x},{y},{z},0,0,1,{r},{d}"),
        (
            "Name;Nominal X;X Ist;Y Soll;Z theo.;Vector I;Vector J;Vector K;Hole Ø",
            "{n};{x};9;{y};{z};0;0;1;{d}",
        ),
        (
            "Plate 7, inner side;;;;;;;\n\nBez.;X [mm];Y [mm];Z [mm];I;J;K;Durchm.",
            "{n};{x};{y};{z};0;0;1;{d}",
        ),
        (
            "| Hole No. | X (mm) | Y (mm) | Z (mm) | nx | ny | nz | Drill dia. (mm) |\n"
            "|---|---|:--|--:|---|---|---|---|",
            "| {n} | {x} | {y} | {z} | 0 | 0 | 1 | {d} |",
        ),
    ],
)
def test_columns_are_found_by_what_people_call_them(tmp_path, header, row):
    features = read(tmp_path, listed(header, row))
    np.testing.assert_allclose(facts(features), TRUTH)
    assert [f.name for f in features] == ["H1", "H2"]
    assert {f.kind for f in features} == {"hole"}


def test_lengths_are_converted_by_their_header(tmp_path):
    text = listed(
        "name,kind,x [in],y [in],z [in],nx,ny,nz,dia [in]", "{n},hole,{x},{y},{z},0,0,1,{d}"
    )
    expected = np.array(TRUTH)
    expected[:, :4] *= 25.4
    np.testing.assert_allclose(facts(read(tmp_path, text)), expected)


def test_lengths_without_a_unit_are_mm_and_said_unless_somebody_says_otherwise(tmp_path):
    text = listed("name,kind,x,y,z,nx,ny,nz,r", "{n},hole,{x},{y},{z},0,0,1,{r}")
    with collected_remarks() as remarks:
        np.testing.assert_allclose(facts(read(tmp_path, text)), TRUTH)
    assert "taken as mm" in "".join(remarks)
    assert read(tmp_path, text, unit="cm")[0].radius_mm == 62.5


@pytest.mark.parametrize("header", ["size_mm", "Größe [mm]", "Nominal", "Hole size"])
def test_a_size_that_may_be_either_is_asked(tmp_path, header):
    text = listed(f"name,kind,x_mm,y_mm,z_mm,nx,ny,nz,{header}", "{n},hole,{x},{y},{z},0,0,1,{d}")
    with pytest.raises(AmbiguousError, match="radius or a diameter") as caught:
        read(tmp_path, text)
    assert caught.value.readings == ("size=radius", "size=diameter")
    np.testing.assert_allclose(facts(read(tmp_path, text, size="diameter")), TRUTH)
    with reading_as(Reading(size="radius")):
        assert read_features(tmp_path / "list.csv")[0].radius_mm == 12.5


def test_a_size_beside_a_radius_is_not_read(tmp_path):
    text = listed("name,x_mm,y_mm,z_mm,nx,ny,nz,size,radius_mm", "{n},{x},{y},{z},0,0,1,99,{r}")
    with collected_remarks() as remarks:
        np.testing.assert_allclose(facts(read(tmp_path, text)), TRUTH)
    assert "not read: size" in "".join(remarks)


def test_a_radius_that_is_not_half_the_diameter_is_refused(tmp_path):
    header = "name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm,diameter_mm"
    with pytest.raises(FeatureError, match=r"'H1': the radius .* is not half the diameter"):
        read(tmp_path, listed(header, "{n},hole,{x},{y},{z},0,0,1,{r},{r}"))


def test_slots_have_their_width_as_diameter(tmp_path):
    text = (
        "Name;Typ;X [mm];Y [mm];Z [mm];nx;ny;nz;Ø [mm];Länge [mm];Breite [mm];tx;ty;tz\n"
        "L1;Langloch;1;2;3;0;0;1;;20;8;0;1;0\nL2;slotted hole;1;2;3;0;0;1;8;20;;0;1;0\n"
        "B1;Bohrung;1;2;3;0;0;1;12;0;0;;;\n"
    )
    one, two, bore = read(tmp_path, text)
    assert one.kind == two.kind == "slot"
    assert (one.radius_mm, one.length_mm, one.width_mm) == (4, 20, 8)
    assert (two.radius_mm, two.length_mm, two.width_mm) == (4, 20, 8)
    assert one.part_from_feature.rotation[:, 0].tolist() == [0, 1, 0]
    assert (bore.radius_mm, bore.length_mm) == (6, None)


def test_without_kinds_a_list_with_lengths_is_asked_for_them(tmp_path):
    text = "name,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm,length_mm\na,1,2,3,0,0,1,4,20\n"
    with pytest.raises(FormatError, match="missing column kind"):
        read(tmp_path, text)


def test_directions_are_scaled_and_positions_are_refused(tmp_path):
    header = "Name,Type,X,Y,Z,I,J,K,R"
    row = "{n},hole,{x},{y},{z},{i},{j},{k},{r}"
    diagonal = read(tmp_path, listed(header, row, i=0, j=1, k=1))
    np.testing.assert_allclose(facts(diagonal)[0][4:], [0, 0.5**0.5, 0.5**0.5])
    with pytest.raises(FeatureError, match=r"normal .* must have length 1, got 13\.9"):
        read(tmp_path, listed(header, row, i=9, j=8, k=7))
    with pytest.raises(FeatureError, match=r"normal .* must have length 1, got 0"):
        read(tmp_path, listed(header, row, i=0, j=0, k=0))


@pytest.mark.parametrize("normal", ["+Z", "z", "Z+", "0 0 1", "(0, 0, 1)", "[0;0;1]"])
def test_a_normal_may_stand_in_one_column(tmp_path, normal):
    text = listed("Name\tX\tY\tZ\tNormal\tR", f"{{n}}\t{{x}}\t{{y}}\t{{z}}\t{normal}\t{{r}}")
    np.testing.assert_allclose(facts(read(tmp_path, text)), TRUTH)
    text = listed("Name\tX\tY\tZ\tNormal\tR", "{n}\t{x}\t{y}\t{z}\tup\t{r}")
    with pytest.raises(FeatureError, match="'H1': column nx, ny, nz: expected a number, got none"):
        read(tmp_path, text)


def test_inward_normals_are_turned_where_somebody_says_so(tmp_path):
    header = "name,kind,x_mm,y_mm,z_mm,nx,ny,nz,"
    for size in ("radius_mm", "R [mm]"):  # our own file, and another
        text = listed(header + size, "{n},hole,{x},{y},{z},0,0,-1,{r}")
        assert facts(read(tmp_path, text))[0][-1] == -1
        assert facts(read(tmp_path, text, normals="inward"))[0][-1] == 1


@pytest.mark.parametrize("last", ["radius_mm", "R"])
def test_all_faults_are_told_at_once(tmp_path, last):
    lines = [
        *("a,hole,1,2,3,0,0,1,6", "b,screw,1,2,3,0,0,1,6", "a,hole,1,2,3,0,0,1,0"),
        *(f"c{i},hole,1,2,3,0,0,1,-1" for i in range(20)),
    ]
    text = f"name,kind,x_mm,y_mm,z_mm,nx,ny,nz,{last}\n" + "\n".join(lines)
    with pytest.raises(FeatureError) as caught:
        read(tmp_path, text)
    told = str(caught.value)
    assert "list.csv, row 3, feature 'b': " in told
    assert "row 4, feature 'a'" in told
    assert "13 more faults, 23 in all" in told


def test_names_that_repeat_are_all_told(tmp_path):
    text = "Name;X;Y;Z;I;J;K;R\n" + "".join(
        f"{n};1;2;3;0;0;1;6\n" for n in ("a", "b", "a", "b", "b")
    )
    with pytest.raises(FeatureError, match="'a' is there twice, in the rows 2 and 4") as caught:
        read(tmp_path, text)
    assert "'b' is there 3 times, in the rows 3, 5 and 6" in str(caught.value)


def test_cells_that_are_no_numbers_are_told_with_their_rows(tmp_path):
    text = "Name;X;Y;Z;I;J;K;R\na;1;?;3;0;0;1;6\nb;1;2;3;0;0;1;six\n"
    with pytest.raises(FormatError, match=r"line 2, Y: '\?'.*line 3, R: 'six'"):
        read(tmp_path, text)
    with pytest.raises(FeatureError, match="row 2, feature 'a': column y_mm: expected a number"):
        read(tmp_path, "Name;X;Y;Z;I;J;K;R\na;1;;3;0;0;1;6\n")


def test_our_own_file_says_nothing(tmp_path, part):
    (tmp_path / "features.csv").write_text(features_to_csv(part.features))
    with collected_remarks() as remarks:
        read_features(tmp_path / "features.csv")
    assert not remarks


@pytest.mark.parametrize(
    ("word", "kind"),
    [
        *((kind, kind) for kind in RULES),
        *(("Kreis", "hole"), ("ROUND_HOLE", "hole"), ("Circle 12", "hole"), ("Lang-Loch", "slot")),
        *(("Oblong hole", "slot"), ("Kugel", "sphere"), ("Punkt", "surface_point")),
        *(("screw", None), ("", None), ("plane", None)),
    ],
)
def test_kinds_are_known_by_the_words_for_them(word, kind):
    assert kind_of(word) == kind


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("list.xlsx", b"PK\3\4", "save its sheet as CSV"),
        ("part.step", b"ISO-10303-21;\n", "exposight part"),
        ("part.stl", b"solid part\n", "exposight part"),
    ],
)
def test_what_is_no_list_says_what_to_do(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError, match=message):
        read_features(tmp_path / name)


@settings(max_examples=30, deadline=None)
@given(
    holes=st.lists(
        st.tuples(*[st.floats(-900, 900).map(lambda x: round(x, 3))] * 3, st.integers(1, 99)),
        min_size=2,
        max_size=5,
    ),
    separator=st.sampled_from([";", "\t"]),
    order=st.permutations(["name", "kind", "x", "y", "z", "i", "j", "k", "d"]),
)
def test_any_order_and_separator_with_decimal_commas_is_the_same_list(
    tmp_path_factory, holes, separator, order
):
    path = tmp_path_factory.mktemp("any") / "list.txt"
    rows = [
        {"name": f"H{n}", "kind": "Kreis", "x": x, "y": y, "z": z, "i": 0, "j": 0, "k": 1, "d": d}
        for n, (x, y, z, d) in enumerate(holes)
    ]
    lines = [[str(row[key]).replace(".", ",") for key in order] for row in rows]
    path.write_text("\n".join(separator.join(cells) for cells in [order, *lines]))
    found = facts(read_features(path, reading=Reading(decimal="comma")))
    np.testing.assert_allclose(found, [[x, y, z, d / 2, 0, 0, 1] for x, y, z, d in holes])


@pytest.mark.parametrize("header", ["name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm",
                                    "Name,Type,X,Y,Z,I,J,K,Radius"])  # fmt: skip
def test_numbers_that_stand_for_missing_values_are_no_places(tmp_path, header):
    text = listed(header, "{n},hole,{x},{y},{z},0,0,1,{r}")
    with pytest.raises(FeatureError, match=r"'H2'.* 9999 seems to stand for a missing value"):
        read(tmp_path, text.replace("51.75", "9999"))
    far = read(tmp_path, text.replace("51.75", "-999").replace("-62.5", "-612.5"))
    assert facts(far)[1][0] == -999
