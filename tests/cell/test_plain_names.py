"""Names of foreign files carry no control characters: each door refuses them, and says which."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from tests.cell.conftest import small_capture, small_part, small_sensor

from exposight.cell import (
    ActiveSensor,
    CampaignWriter,
    Feature,
    MemoryCampaign,
    Part,
    read_features,
)
from exposight.cell.capture import CaptureDescription
from exposight.errors import ExposightError
from exposight.files import spelled, validate
from exposight.geometry import RigidTransform
from exposight.imaging import SEQUENCE_PRESETS
from exposight.planning.exposure_limits import ExposureLimits
from exposight.planning.exposure_plan import PlanView
from exposight.plans import plan_preset
from exposight.plans.files import plan_from_text
from exposight.twin.part.finishes import Finishes
from exposight.twin.part.surfaces import SURFACES

_NAMES = ["a\x1b[31mb", "a\u202eb", "a\nb", "a\ud800b"]


def _feature(name: str) -> Feature:
    return Feature(name=name, kind="hole", part_from_feature=RigidTransform(), radius_mm=5.0)


def _campaign(name: str) -> MemoryCampaign:
    return MemoryCampaign(name=name, sensor=small_sensor(), part=small_part(), captures=[])


def _description(view: str) -> CaptureDescription:
    document = {
        "view": view,
        "exposure_ms": 1.0,
        "bit_depth": 8,
        "emulated": False,
        "notes": "",
        "camera_from_part": RigidTransform().to_matrix().tolist(),
        "image_sha256": "0" * 64,
        "cloud_sha256": None,
    }
    return validate(CaptureDescription, document, "capture.json")


def _sensor(name: str) -> ActiveSensor:
    document = {**json.loads(small_sensor().to_json()), "name": name}
    return ActiveSensor.from_json(json.dumps(document))


_DOORS = {
    "feature": _feature,
    "finish": lambda name: replace(_feature("f"), finish=name),
    "part": lambda name: Part(name=name, features=(_feature("f"),)),
    "sensor": lambda name: replace(small_sensor(), name=name),
    "sensor's document": _sensor,
    "view": lambda name: small_capture(10.0, name),
    "view's description": _description,
    "campaign": _campaign,
    "plan": lambda name: replace(plan_preset("small"), name=name),
    "plane": lambda name: replace(plan_preset("small").planes[0], name=name),
    "view of a plan": lambda name: PlanView(name=name, camera_from_part=None, exposures=()),
    "limits": lambda name: ExposureLimits(name=name, min_ms=1, max_ms=2, increment_ms=1),
    "sequence": lambda name: replace(SEQUENCE_PRESETS["board"], name=name),
    "surface": lambda name: Finishes(surfaces={name: next(iter(SURFACES.values()))}),
}


@pytest.mark.parametrize("name", _NAMES, ids=ascii)
@pytest.mark.parametrize("door", _DOORS.values(), ids=_DOORS)
def test_a_name_with_control_characters_is_refused(door, name):
    with pytest.raises(ExposightError) as refused:
        door(name)
    assert spelled(str(refused.value)) == str(refused.value)


@pytest.mark.parametrize("door", [_DOORS[each] for each in ("feature", "part", "view", "campaign")])
def test_other_names_are_as_they_were(door):
    door("Bohrung\u00a01 – ø 漢字 👩\u200d🔧")


@pytest.mark.parametrize("name", _NAMES[:2], ids=ascii)
def test_a_writer_makes_no_campaign_of_such_a_name(tmp_path, name):
    with pytest.raises(ExposightError, match="holds the control character"):
        CampaignWriter.open_or_create(
            tmp_path / "c", name=name, sensor=small_sensor(), part=small_part()
        )
    assert not (tmp_path / "c" / "campaign.json").exists()


@pytest.mark.parametrize("name", [r"a\u001B[31mb", r"a\u202eb"])
def test_a_plans_text_cannot_spell_them(name):
    text = f'format = "exposight measuring plan"\nversion = 2\nname = "{name}"\n'
    text += 'sensor = "comet-pro-ae"\nfeatures = ["f1"]\nreference = "f1"\n[[planes]]\n'
    text += 'name = "a"\nz_tcp_mm = 0\nx_mm = [0]\ny_mm = [0]\nexposures_ms = [10]\n'
    with pytest.raises(ExposightError, match="holds the control character"):
        plan_from_text(text)


@pytest.mark.parametrize("name", ["a\x1b[31mb", "a\u202eb"], ids=ascii)
@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("part.csv", "name,kind,x_mm,y_mm,z_mm,nx,ny,nz,radius_mm\n{},hole,0,0,0,0,0,1,5\n"),
        (
            "part.dmi",
            "DMISMN/'p',05.2\r\nUNITS/MM,ANGDEC\r\nF({})=FEAT/CIRCLE,INNER,CART,1,2,3,0,0,1,12\r\n",
        ),
        (
            "part.qif",
            '<?xml version="1.0"?><QIFDocument xmlns="http://qifstandards.org/xsd/qif3"><Features>'
            '<FeatureDefinitions><CircleFeatureDefinition id="1"><InternalExternal>INTERNAL'
            "</InternalExternal><Diameter>12</Diameter></CircleFeatureDefinition>"
            '</FeatureDefinitions><FeatureNominals><CircleFeatureNominal id="2">'
            "<FeatureDefinitionId>1</FeatureDefinitionId><Name>{}</Name><Location>1 2 3</Location>"
            "<Normal>0 0 1</Normal></CircleFeatureNominal></FeatureNominals></Features>"
            "</QIFDocument>",
        ),
    ],
)
def test_lists_of_features_of_others_cannot_bring_them(tmp_path, file, text, name):
    path: Path = tmp_path / file
    path.write_text(text.format(name), encoding="utf-8")
    with pytest.raises(ExposightError) as refused:
        read_features(path)
    assert spelled(str(refused.value)).replace("\\n", "\n") == str(refused.value)
