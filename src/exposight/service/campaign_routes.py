"""Campaigns over HTTP, as they grow: what they are of, captures, images, rings, observations."""

from __future__ import annotations

import hashlib
from copy import copy
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Header, Query, Request, Response
from pydantic import BaseModel, Field

from exposight.cell import CampaignFolder
from exposight.errors import FileError, FormatError, MissingFileError
from exposight.files import csv_of
from exposight.measuring.view_work import campaign_rows
from exposight.observing import parse_observations
from exposight.service import shown_campaigns
from exposight.service.faults import RequestError, answer, fault_answers
from exposight.service.folder import ServedFolder, is_whole_capture

router = APIRouter(tags=["campaigns"])


class CampaignSummary(BaseModel):
    """What a campaign is of."""

    name: str = Field(description="Its path in the served folder.")
    part: str
    sensor: str
    n_captures: int
    views: list[str] = Field(description="In the order in which they were first captured.")
    exposures_ms: list[float] = Field(description="Exposure times in ms, ascending.")


class CampaignList(BaseModel):
    """All campaigns in the served folder."""

    campaigns: list[CampaignSummary]


class CampaignFeature(BaseModel):
    """A feature of the part."""

    name: str
    kind: str
    finish: str | None
    radius_mm: float
    position_mm: list[float] = Field(description="In the part's frame: x, y, z.")
    normal: list[float] = Field(description="Outward, in the part's frame.")


class CampaignDetails(CampaignSummary):
    """A campaign with its features."""

    features: list[CampaignFeature]


class CaptureSummary(BaseModel):
    """A capture."""

    number: int
    view: str
    exposure_ms: float = Field(description="As read back from the sensor, ms.")
    camera_from_part: list[list[float]] = Field(description="4 × 4 matrix, mm.")


class CaptureList(BaseModel):
    """A campaign's captures, in the order in which they were taken."""

    captures: list[CaptureSummary]


class Ring(BaseModel):
    """A feature's ring in an image."""

    feature: str
    outline: list[list[float]] = Field(
        description="Points (u, v) in px, u the column; empty where the ring is not in the image."
    )
    p_norm: float | None = Field(description="As measured, 0 to 1; null where it was not.")
    status: str = Field(description="visible, or why the feature cannot be measured here.")


class Rings(BaseModel):
    """All features' rings in a capture's image."""

    width: int = Field(description="Of the image, px.")
    height: int = Field(description="Of the image, px.")
    rings: list[Ring]


class ObservationRows(BaseModel):
    """The rows of a campaign's observation table."""

    observations: list[dict[str, Any]] = Field(description="A row for each feature and capture.")


Known = Annotated[
    str | None, Header(alias="If-None-Match", description="An ETag that the client knows.")
]

_UNCHANGED: dict[int | str, dict[str, Any]] = {304: {"description": "As the client knows it."}}


def _campaign(request: Request, name: str, number: int | None = None) -> CampaignFolder:
    """Return a campaign with the captures whose files are in the served folder now.

    Where a number is given, only that capture is looked at.
    """
    folder: ServedFolder = request.app.state.folder
    campaign = copy(folder.campaign(name))  # the kept one stays as it is
    campaign.numbers = tuple(
        each
        for each in campaign.numbers
        if number not in {None, each}
        or is_whole_capture(shown_campaigns.capture_folder(campaign, each), folder.root)
    )
    return campaign


def _tag(*decisive: object) -> str:
    return f'"{hashlib.sha256(repr(decisive).encode()).hexdigest()[:24]}"'


def _unchanged(known: str | None, tag: str) -> Response | None:
    """Return the answer that a client knows already, if it does."""
    tags = [each.strip().removeprefix("W/") for each in (known or "").split(",")]
    if tag in tags or "*" in tags:
        return Response(status_code=304, headers={"ETag": tag})
    return None


def _campaign_tag(campaign: CampaignFolder) -> str:
    try:
        changed = (campaign.path / "campaign.json").stat().st_mtime_ns
    except OSError as error:
        msg = f"campaign {campaign.name!r} is not there any more"
        raise MissingFileError(msg) from error
    return _tag(str(campaign.path), changed, campaign.numbers)


def _capture_tag(campaign: CampaignFolder, number: int, *further: object) -> str:
    about = shown_campaigns.description(campaign, number)
    return _tag(about.image_sha256, about.cloud_sha256, about.beside_sha256, *further)


@router.get("/v1/campaigns", response_model=CampaignList, responses=fault_answers())
def list_campaigns(request: Request) -> Response:
    """Return all campaigns in the served folder; damaged ones are left out."""
    folder: ServedFolder = request.app.state.folder
    campaigns = []
    for name in folder.listing().campaigns:
        try:
            campaigns.append(shown_campaigns.summary(name, _campaign(request, name)))
        except (FileError, OSError):
            continue
    return answer({"campaigns": campaigns})


@router.get(
    "/v1/campaigns/{name:path}/captures/{number}/image",
    response_class=Response,
    responses={
        200: {
            "description": "The image.",
            "content": {"image/png": {}, "image/jpeg": {}},
        },
        **_UNCHANGED,
        **fault_answers(404),
    },
)
def capture_image(
    request: Request,
    name: str,
    number: int,
    width: Annotated[
        int | None, Query(ge=16, le=8192, description="Scale wider images down to this, px.")
    ] = None,
    known: Known = None,
) -> Response:
    """Return a capture's image: PNG as it was kept, or JPEG of a smaller width."""
    campaign = _campaign(request, name, number)
    tag = _capture_tag(campaign, number, width)
    if same := _unchanged(known, tag):
        return same
    data, kind = shown_campaigns.image(campaign, number, width)
    return Response(data, media_type=kind, headers={"ETag": tag, "Cache-Control": "no-cache"})


@router.get(
    "/v1/campaigns/{name:path}/captures/{number}/rings",
    response_model=Rings,
    responses={**_UNCHANGED, **fault_answers(404)},
)
def capture_rings(request: Request, name: str, number: int, known: Known = None) -> Response:
    """Return where the features' rings are in a capture's image, and how well they were measured.

    Of a capture that was kept without observations the points are counted when it is first asked.
    """
    campaign = _campaign(request, name, number)
    tag = _capture_tag(campaign, number)
    if same := _unchanged(known, tag):
        return same
    return answer(shown_campaigns.rings(campaign, number), headers={"ETag": tag})


@router.get(
    "/v1/campaigns/{name:path}/captures",
    response_model=CaptureList,
    responses={**_UNCHANGED, **fault_answers(404)},
)
def list_captures(request: Request, name: str, known: Known = None) -> Response:
    """Return a campaign's captures."""
    campaign = _campaign(request, name)
    tag = _campaign_tag(campaign)
    if same := _unchanged(known, tag):
        return same
    return answer({"captures": shown_campaigns.captures(campaign)}, headers={"ETag": tag})


@router.get(
    "/v1/campaigns/{name:path}/observations",
    response_model=ObservationRows,
    responses={
        200: {
            "model": ObservationRows,
            "content": {"text/csv": {"schema": {"type": "string"}}},
            "description": "The rows, as JSON or CSV.",
        },
        **_UNCHANGED,
        **fault_answers(404, 409),
    },
)
def campaign_observations(
    request: Request,
    name: str,
    format: Annotated[Literal["json", "csv"], Query(description="json or csv.")] = "json",
    known: Known = None,
) -> Response:
    """Return the observations that were kept with a campaign's captures, as closed loops do."""
    campaign = _campaign(request, name)
    tag = _tag(_campaign_tag(campaign), format)
    if same := _unchanged(known, tag):
        return same
    try:
        table = parse_observations(campaign_rows(campaign), f"observations of {name}")
    except FormatError as error:
        msg = f"{name} has no observations: `exposight observe` makes a table of its captures"
        raise RequestError(409, msg) from error
    headers = {"ETag": tag}
    if format == "csv":
        return Response(csv_of(table.frame), media_type="text/csv", headers=headers)
    frame = table.frame.fill_nan(None)
    return answer({"observations": frame.to_dicts()}, headers=headers)


@router.get(
    "/v1/campaigns/{name:path}",
    response_model=CampaignDetails,
    responses={**_UNCHANGED, **fault_answers(404)},
)
def campaign_details(request: Request, name: str, known: Known = None) -> Response:
    """Return what a campaign is of, with its features."""
    campaign = _campaign(request, name)
    tag = _campaign_tag(campaign)
    if same := _unchanged(known, tag):
        return same
    features = shown_campaigns.features(campaign)
    body = {**shown_campaigns.summary(name, campaign), "features": features}
    return answer(body, headers={"ETag": tag})
