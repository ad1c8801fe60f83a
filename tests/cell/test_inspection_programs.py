import numpy as np
import pytest

from exposight.cell import read_features
from exposight.errors import FeatureError, FormatError
from exposight.files import Reading, collected_remarks


def outward(feature):
    return (0.0 - feature.part_from_feature.z_axis).tolist()


def read(tmp_path, text, name="list.txt", **reading):
    (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_features(tmp_path / name, reading=Reading(**reading))


# -- DMIS ----------------------------------------------------------------------------------------

CIRCLE = "F({})=FEAT/CIRCLE,INNER,CART,{},0,0,1,12\n"


def test_circles_and_slots_of_dmis_are_holes_and_slots(tmp_path):
    text = (
        "$$ by hand F(X)=FEAT/CIRCLE,INNER,CART,0,0,0,0,0,1,1\r\nDMISMN/'part',05.2\r\n"
        "UNITS/MM,ANGDEC\r\nf(H1) = feat/circle, inner, cart, -60,-40.0, $\r\n 1.5, 0,0,1, 12.\r\n"
        "F(S1)=FEAT/CPARLN,INNER,ROUND,CART,1,2,3,0,0,1,-1,0,0,20,8\r\n"
        "F(P1)=FEAT/CPARLN,INNER,FLAT,CART,1,2,3,0,0,1,0,1,0,20,8\r\n"
        "F(B1)=FEAT/SPHERE,OUTER,CART,1,2,3,10,0,0,1\r\n"
    )
    with collected_remarks() as remarks:
        hole, slot, pocket, sphere = read(tmp_path, text)
    assert (hole.name, hole.kind, hole.radius_mm) == ("H1", "hole", 6)
    assert hole.part_from_feature.translation_mm.tolist() == [-60, -40, 1.5]
    assert outward(hole) == [0, 0, 1]
    assert (slot.kind, slot.radius_mm, slot.length_mm, slot.width_mm) == ("slot", 4, 20, 8)
    assert slot.part_from_feature.rotation[:, 0].tolist() == [-1, 0, 0]
    assert (pocket.kind, pocket.radius_mm) == ("pocket", 0)
    assert (sphere.kind, sphere.radius_mm) == ("sphere", 5)
    assert "DMIS program" in "".join(remarks)


@pytest.mark.parametrize(("unit", "mm"), [("INCH", 25.4), ("CM", 10), ("M", 1000), ("MM", 1)])
def test_dmis_units_are_converted(tmp_path, unit, mm):
    (hole,) = read(tmp_path, f"UNITS/{unit},ANGDEC\n" + CIRCLE.format("a", "1,2,3"))
    np.testing.assert_allclose(hole.part_from_feature.translation_mm, [mm, 2 * mm, 3 * mm])
    assert hole.radius_mm == pytest.approx(6 * mm)


def test_dmis_without_units_is_in_mm_unless_somebody_says_otherwise(tmp_path):
    text = CIRCLE.format("a", "1,2,3")
    with collected_remarks() as remarks:
        assert read(tmp_path, text)[0].radius_mm == 6
    assert "taken as mm" in "".join(remarks)
    assert read(tmp_path, text, unit="inch")[0].radius_mm == pytest.approx(6 * 25.4)


@pytest.mark.parametrize(
    ("before", "place", "expected"),
    [
        ("UNITS/MM,ANGDEC\n", "10,30,5", [8.660254, 5, 5]),
        ("UNITS/MM,ANGDMS\n", "10,30:00:00,5", [8.660254, 5, 5]),
        ("UNITS/MM,ANGRAD\n", "10,0.5235987756,5", [8.660254, 5, 5]),
        ("UNITS/MM,ANGDEC\nWKPLAN/YZPLAN\n", "10,30,5", [5, 8.660254, 5]),
        ("UNITS/MM,ANGDEC\nWKPLAN/ZXPLAN\n", "10,30,5", [5, 5, 8.660254]),
    ],
)
def test_polar_coordinates_of_dmis_are_turned(tmp_path, before, place, expected):
    (hole,) = read(tmp_path, before + CIRCLE.replace("CART", "POL").format("a", place))
    np.testing.assert_allclose(hole.part_from_feature.translation_mm, expected, atol=1e-6)


def test_what_dmis_has_beside_holes_is_left_out_and_said(tmp_path):
    text = (
        "UNITS/MM,ANGDEC\nF(P)=FEAT/PLANE,CART,0,0,0,0,0,1\n"
        "F(O)=FEAT/CIRCLE,OUTER,CART,0,0,0,0,0,1,5\n" + CIRCLE.format("a", "1,2,3")
    )
    with collected_remarks() as remarks:
        assert [f.name for f in read(tmp_path, text)] == ["a"]
    assert "not read: 1 PLANE, 1 CIRCLE OUTER" in "".join(remarks)
    with pytest.raises(FeatureError, match=r"expected features FEAT/CIRCLE,INNER .* 1 PLANE"):
        read(tmp_path, "\n".join(text.split("\n")[:2]))

    pc_dmis = "CIR1 =FEAT/CIRCLE,CARTESIAN,IN\n THEO/<1,2,3>,<0,0,1>,12\n"
    with pytest.raises(FeatureError, match="a program of PC-DMIS: export it as DMIS"):
        read(tmp_path, pc_dmis)


def test_dmis_coordinates_that_move_between_features_are_refused(tmp_path):
    a, b = CIRCLE.format("a", "1,2,3"), CIRCLE.format("b", "4,5,6")
    move = "D(2)=TRANS/XORIG,10\n"
    assert len(read(tmp_path, "UNITS/MM,ANGDEC\nDATSET/MCS\n" + a + "RECALL/S(1)\n" + b)) == 2
    assert len(read(tmp_path, ("UNITS/MM,ANGDEC\n" + a + b).encode("utf-16"))) == 2
    with pytest.raises(FormatError, match="row 3 moves the coordinates"):
        read(tmp_path, "UNITS/MM,ANGDEC\n" + a + "RECALL/D(1)\n" + b)
    with collected_remarks() as remarks:
        assert len(read(tmp_path, "UNITS/MM,ANGDEC\n" + move + a + b)) == 2
    assert "in the coordinates that row 2 sets" in "".join(remarks)
    with pytest.raises(FormatError, match="row 3 moves the coordinates between feature 'a' and"):
        read(tmp_path, "UNITS/MM,ANGDEC\n" + a + move + b)


def test_faults_of_a_dmis_program_are_told_at_once(tmp_path):
    text = (
        "UNITS/MM,ANGDEC\nF(a)=FEAT/CIRCLE,INNER,CART,1,2\nF(b)=FEAT/CIRCLE,INNER,CART,X1,2,3,0,0,1,5\n"
        "F(c)=FEAT/CIRCLE,INNER,CART,1,2,3,0,0,7,5\n" + 2 * CIRCLE.format("d", "1,2,3")
    )
    with pytest.raises(FormatError, match="row 2, feature 'a': expected 7 numbers") as caught:
        read(tmp_path, text)
    for part in ("row 3, feature 'b'", "row 4, feature 'c'", "'d' is there twice"):
        assert part in str(caught.value)


def test_normals_of_dmis_are_turned_where_somebody_says_so(tmp_path):
    (hole,) = read(tmp_path, CIRCLE.format("a", "1,2,3"), normals="inward")
    assert outward(hole) == [0, 0, -1]


# -- QIF -----------------------------------------------------------------------------------------

MM = (
    "<PrimaryUnits><LinearUnit><SIUnitName>meter</SIUnitName><UnitName>mm</UnitName>"
    "<UnitConversion><Factor>0.001</Factor></UnitConversion></LinearUnit></PrimaryUnits>"
)
HOLE = "<InternalExternal>INTERNAL</InternalExternal><Diameter>12</Diameter>"
PLACED = "<Name>H1</Name><Location>1 2 3</Location><Normal>0 0 1</Normal>"
SLOT = "<InternalExternal>INTERNAL</InternalExternal><Diameter>8</Diameter><Length>20</Length>{}"
LINE = (
    "<Name>S1</Name><CenterLine><Point>1 2 3</Point><Vector>0 1 0</Vector></CenterLine>"
    "<Normal>0 0 1</Normal>"
)


def qif(kind="Circle", definition=HOLE, nominal=PLACED, units=MM, items="", start=""):
    return (
        f'<?xml version="1.0"?>{start}<QIFDocument xmlns="http://qifstandards.org/xsd/qif3">'
        f"<FileUnits>{units}</FileUnits><Features><FeatureDefinitions>"
        f'<{kind}FeatureDefinition id="1">{definition}</{kind}FeatureDefinition>'
        f'</FeatureDefinitions><FeatureNominals><{kind}FeatureNominal id="2">'
        f"<FeatureDefinitionId>1</FeatureDefinitionId>{nominal}</{kind}FeatureNominal>"
        f"</FeatureNominals><FeatureItems>{items}</FeatureItems></Features></QIFDocument>"
    )


def test_circles_of_qif_are_holes(tmp_path):
    (hole,) = read(tmp_path, qif(), "plan.xml")
    assert (hole.name, hole.kind, hole.radius_mm) == ("H1", "hole", 6)
    assert hole.part_from_feature.translation_mm.tolist() == [1, 2, 3]
    assert outward(hole) == [0, 0, 1]
    assert outward(read(tmp_path, qif(), normals="inward")[0]) == [0, 0, -1]


@pytest.mark.parametrize(
    ("units", "mm"),
    [
        ("", 1000),
        (MM, 1),
        (MM.replace("mm", "inch").replace("0.001", "0.0254"), 25.4),
        (
            "<PrimaryUnits><LinearUnit><SIUnitName>meter</SIUnitName></LinearUnit></PrimaryUnits>",
            1000,
        ),
    ],
)
def test_lengths_of_qif_are_in_its_units_or_metres(tmp_path, units, mm):
    (hole,) = read(tmp_path, qif(units=units))
    assert hole.radius_mm == pytest.approx(6 * mm)
    np.testing.assert_allclose(hole.part_from_feature.translation_mm, [mm, 2 * mm, 3 * mm])


def test_a_length_of_qif_in_another_unit_is_converted_or_named(tmp_path):
    other = "<OtherUnits>" + MM[14:-15].replace("mm", "inch").replace("0.001", "0.0254")
    definition = HOLE.replace("<Diameter>", '<Diameter linearUnit="inch">')
    (hole,) = read(tmp_path, qif(definition=definition, units=MM + other + "</OtherUnits>"))
    assert hole.radius_mm == pytest.approx(6 * 25.4)
    with pytest.raises(FormatError, match="Diameter is in 'inch', a unit that the document does"):
        read(tmp_path, qif(definition=definition))


def test_slots_of_qif_end_round_or_flat(tmp_path):
    (slot,) = read(tmp_path, qif("ElongatedCircle", SLOT.format(""), LINE))
    assert (slot.kind, slot.radius_mm, slot.length_mm, slot.width_mm) == ("slot", 4, 20, 8)
    assert slot.part_from_feature.rotation[:, 0].tolist() == [0, 1, 0]
    lines = SLOT.replace("Diameter", "Width").format(
        "<EndType><SlotEndEnum>{}</SlotEndEnum></EndType>"
    )
    kinds = {
        ends: read(tmp_path, qif("OppositeParallelLines", lines.format(ends), LINE))[0].kind
        for ends in ("ROUND", "FLAT")
    }
    assert kinds == {"ROUND": "slot", "FLAT": "pocket"}
    with pytest.raises(FeatureError, match="ROUND or FLAT ends, got 'OPEN'"):
        read(tmp_path, qif("OppositeParallelLines", lines.format("OPEN"), LINE))


def test_names_of_qif_may_stand_with_its_items(tmp_path):
    items = (
        '<CircleFeatureItem id="9"><FeatureNominalId>2</FeatureNominalId>'
        "<FeatureName>Bore</FeatureName></CircleFeatureItem>"
    )
    nominal = PLACED.replace("<Name>H1</Name>", "")
    assert read(tmp_path, qif(nominal=nominal, items=items))[0].name == "Bore"


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (qif(start='<!DOCTYPE a [<!ENTITY b "c">]>'), "has no DOCTYPE"),
        (qif(start='<!DOCTYPE a [<!ENTITY b "c">]>').encode("utf-16"), "has no DOCTYPE"),
        (qif()[:-30], "cannot be read as XML"),
        (qif("Plane"), "nominal circles or slots .*, got 1 PlaneFeature"),
        (qif(definition=HOLE.replace("INTERNAL", "EXTERNAL")), "got 1 external CircleFeature"),
        (qif(nominal="<Name>H1</Name>"), "'H1': expected three numbers as Normal"),
        (qif(definition=HOLE.replace("12", "wide")), "expected a number as Diameter, got 'wide'"),
    ],
)
def test_what_is_wrong_with_a_qif_document_is_said(tmp_path, document, message):
    with pytest.raises((FormatError, FeatureError), match=message):
        read(tmp_path, document, "plan.qif")
