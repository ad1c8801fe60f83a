"""Two demonstrations in miniature, on one plate: three exposures, small models."""

import json
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from exposight.cell import (
    ActiveSensor,
    Capture,
    Cloud,
    ExposureRange,
    Feature,
    MemoryCampaign,
    Part,
)
from exposight.demo import (
    DoorMesh,
    DoorResult,
    DoorSettings,
    ModelResult,
    NewView,
    SequenceCheck,
    SkullResult,
    SkullSettings,
)
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.imaging import CloudAgreement, DecodingCounts
from exposight.models import evaluate, model_named, train
from exposight.observing import observe_campaign, view_features
from exposight.planning import forecast
from exposight.report.door import door_report
from exposight.report.skull import skull_report
from exposight.statistics import score

EVIL = "<x>&\"'</script>"
"""A feature's name that would break a page which does not escape it."""

_DISTANCE_MM = 300.0
_EXPOSURES_MS = (4.217, 10.0, 23.714)


def _sensor():
    camera = PinholeCamera(width=120, height=90, fx=300.0, fy=300.0, cx=59.5, cy=44.5)
    return ActiveSensor(
        name="tiny <rig>",
        cameras=(camera,),
        first_from_camera=(RigidTransform(),),
        projector=None,
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, _DISTANCE_MM])),
        exposure=ExposureRange(min_ms=0.1, max_ms=1000.0, increment_ms=0.001),
        working_distance_mm=(100.0, 1000.0),
    )


def _part():
    places = {EVIL: (-38.0, -24.0), "s002": (-18.0, 20.0), "s003": (10.0, -20.0), "s004": (36, 22)}
    return Part(
        name="plate",
        features=tuple(
            Feature(
                name=name,
                kind="hole",
                part_from_feature=RigidTransform(translation_mm=np.array([x, y, _DISTANCE_MM])),
                radius_mm=4.0 + 0.5 * number,
            )
            for number, (name, (x, y)) in enumerate(places.items())
        ),
    )


def _capture(exposure_ms):
    """A plate lit brighter to the right; points where the grey value is neither dark nor full."""
    v, u = np.mgrid[0:90, 0:120].astype(np.float64)
    grey = np.minimum(np.rint((4.0 + 0.12 * u) * exposure_ms), 255.0)
    points = np.stack([u - 59.5, v - 44.5, np.full_like(u, 300.0)], axis=-1)
    points[(grey < 30) | (grey >= 255)] = np.nan
    return Capture(
        view="plate",
        exposure_ms=exposure_ms,
        image=grey.astype(np.uint8),
        cloud=Cloud(points=points),
        camera_from_part=RigidTransform(),
        emulated=exposure_ms != 10.0,
    )


def _model_result(name, known, unseen, sensor):
    model = train(model_named(name), known, seed=1, sensor=sensor, restarts=1)
    return ModelResult(
        model=model, known=evaluate(model, known), unseen=evaluate(model, unseen), seconds=0.25
    )


def _check(title, scale):
    return SequenceCheck(
        title=title,
        counts=DecodingCounts(
            pixels=10_800, decoded=9_000, low_modulation=1_500, clipped=12, ambiguous=34, outside=0
        ),
        agreement=CloudAgreement(distances_mm=scale * np.arange(1.0, 101.0)),
        seconds=0.5,
    )


@pytest.fixture(scope="session")
def result():
    sensor, part = _sensor(), _part()
    captures = tuple(_capture(exposure_ms) for exposure_ms in _EXPOSURES_MS)
    campaign = MemoryCampaign(name="plate", sensor=sensor, part=part, captures=captures)
    table = observe_campaign(campaign)
    train_features = frozenset({EVIL, "s003"})
    trains = np.isin(table.names("feature"), list(train_features))
    known, unseen = table.where(trains), table.where(~trains)
    return SkullResult(
        settings=SkullSettings(
            features=4,
            steps_each_way=1,
            steps_per_decade=2,
            restarts=1,
            models=tuple(model_named(name) for name in ("q_k1", "q_k4", "e_k1")),
        ),
        output=Path("demo"),
        sensor=sensor,
        checks=(_check("Gray code", 0.002), _check("phase <shift>", 0.004)),
        sweep=captures,
        cloud=captures[1].cloud,
        views=view_features(part, sensor, RigidTransform()),
        table=table,
        train_features=train_features,
        overlap=0.1234,
        results=tuple(
            _model_result(name, known, unseen, sensor) for name in ("q_k1", "q_k4", "e_k1")
        ),
    )


@pytest.fixture(scope="session")
def page(result):
    return skull_report(result)


@pytest.fixture(scope="session")
def door_result(result):
    """The same plate as if it were a door: every feature in view, three exposures taken."""
    names = ("q_k1", "q_k4", "e_k1")
    trains = np.isin(result.table.names("feature"), list(result.train_features))
    known, unseen = result.table.where(trains), result.table.where(~trains)
    results = tuple(_model_result(name, known, unseen, result.sensor) for name in names)
    # Six inputs need more observations than two features have.
    results += (_model_result("e_k6", result.table, unseen, result.sensor),)
    models = {own.model.name: own.model for own in results}
    both = models["q_k4"], models["e_k6"]
    taken = forecast(*both, result.views, _EXPOSURES_MS)
    measured = result.table.array(["i_avg", "p_norm"]).reshape(3, 4, 2).transpose(2, 1, 0)
    view = NewView(
        position_mm=(40.0, 0.0, 70.0),
        views=result.views,
        choice=forecast(*both, result.views, (2.0, 5.0, 10.0, 20.0)),
        chosen_ms=_EXPOSURES_MS[1],
        taken=taken,
        captures=result.sweep,
        i_avg=measured[0],
        p_norm=measured[1],
        score=score(measured[1].ravel(), taken.p_norm.ravel(), taken.p_norm_std.ravel()),
        field_of_view_mm=np.array([[-60.0, -45, 0], [60, -45, 0], [60, 45, 0], [-60, 45, 0]]),
    )
    corners = np.array([[-60, -45, 300], [60, -45, 300], [60, 45, 302], [-60, 45, 300]])
    return DoorResult(
        settings=DoorSettings(restarts=1),
        output=Path("demo"),
        sensor=result.sensor,
        table=result.table,
        train_features=result.train_features,
        results=results,
        n_views=1,
        n_captures=3,
        new_view=view,
        mesh=DoorMesh(
            vertices=corners.astype(np.float32),
            faces=np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
        ),
    )


@pytest.fixture(scope="session")
def door_page(door_result):
    return door_report(door_result)


@pytest.fixture(scope="session")
def read_door(door_page):
    return PageReader(door_page)


class PageReader(HTMLParser):
    """Everything a browser would find in a page: tags, scripts, and the cells of its tables."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.scripts, self.rows, self.texts = [], [], {}, []
        self._table, self._cell, self._script = None, None, None
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append((tag, attributes))
        if tag == "table":
            self._table = self.rows.setdefault(attributes["id"], [])
        elif tag == "tr" and self._table is not None:
            self._table.append([])
        elif tag in ("td", "th") and self._table is not None:
            self._cell = {"text": "", "value": None}
            self._table[-1].append(self._cell)
        elif tag == "data" and self._cell is not None:
            self._cell["value"] = float(attributes["value"])
        elif tag == "script":
            self._script = {"attributes": attributes, "text": ""}
            self.scripts.append(self._script)

    def handle_endtag(self, tag):
        if tag == "table":
            self._table = None
        elif tag in ("td", "th"):
            self._cell = None
        elif tag == "script":
            self._script = None

    def handle_data(self, data):
        if self._script is not None:
            self._script["text"] += data
            return
        data = data.replace("\u00a0", " ")  # a number and its unit, kept on one line
        self.texts.append(data)
        if self._cell is not None:
            self._cell["text"] += data

    def json(self, name):
        """Return the data block of this id."""
        return next(
            json.loads(script["text"])
            for script in self.scripts
            if script["attributes"].get("id") == name
        )

    def model_row(self, table, model):
        """Return the cells of a model's row."""
        return next(row for row in self.rows[table] if row[0]["text"].endswith(f" {model}"))


@pytest.fixture(scope="session")
def read_page(page):
    return PageReader(page)
