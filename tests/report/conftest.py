"""A campaign in miniature: one plate, four holes, three exposures, small models."""

import base64
import json
from html.parser import HTMLParser

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
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.models import Training, model_named
from exposight.observing import observe_campaign
from exposight.report import PartMesh, campaign_report

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


@pytest.fixture(scope="session")
def campaign():
    captures = tuple(_capture(exposure_ms) for exposure_ms in _EXPOSURES_MS)
    return MemoryCampaign(name="plate", sensor=_sensor(), part=_part(), captures=captures)


@pytest.fixture(scope="session")
def table(campaign):
    return observe_campaign(campaign)


@pytest.fixture(scope="session")
def models(table):
    known = table.where(np.isin(table.names("feature"), [EVIL, "s003"]))
    # Six inputs need more observations than two features have.
    rows = {"q_k1": known, "q_k4": known, "e_k1": known, "e_k6": table}
    return [
        Training(specification=model_named(name), table=known, seed=1, restarts=1).run()
        for name, known in rows.items()
    ]


@pytest.fixture(scope="session")
def report(campaign, models):
    corners = np.array([[-60, -45, 300], [60, -45, 300], [60, 45, 302], [-60, 45, 300]])
    mesh = PartMesh(
        vertices=corners.astype(np.float32),
        faces=np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
    )
    return campaign_report(
        campaign, models, unseen={"s002", "s004"}, mesh=mesh, notes=("A note on <everything>.",)
    )


@pytest.fixture(scope="session")
def page(report):
    return report.html()


@pytest.fixture(scope="session")
def reader():
    """Return what reads a page."""
    return PageReader


@pytest.fixture(scope="session")
def read_page(page):
    return PageReader(page)


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

    def traces(self, name):
        """Return the traces of an interactive figure."""
        return self.json(f"{name}-figure")["data"]

    @staticmethod
    def array(value):
        """An array as plotly writes it: a list, or typed bytes."""
        if isinstance(value, dict):
            flat = np.frombuffer(base64.b64decode(value["bdata"]), dtype=value["dtype"])
            shape = value.get("shape")
            return flat.reshape([int(n) for n in shape.split(",")]) if shape else flat
        return np.asarray(value)
