"""The page of any campaign or table of observations, with models or without."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from exposight.cell import ActiveSensor, CampaignFolder, CaptureSource
from exposight.errors import InputError
from exposight.files import make_folder, write_durably
from exposight.models import P_NORM_MIN, Predictor, load_model
from exposight.observing import ObservationTable, observe_campaign, read_observations
from exposight.report import campaign_summary, model_figures, pictures, shown_view
from exposight.report.palette import CLIPPED, NO_POINT, P_NORM_SCALE
from exposight.report.part_plot import PartMesh, part_plot, read_part_mesh
from exposight.report.reliability_figure import reliability_picture
from exposight.report.rendering import render_page, rounded
from exposight.workers import Progress, ignore_progress

_STAGE = "writing the report"
_CLOSE_UPS = 4
_TARGETS = ("p_norm", "exposure_ms")


@dataclass(frozen=True, kw_only=True, eq=False)
class CampaignReport:
    """Everything that a campaign's page shows.

    Parameters
    ----------
    title, lead : str
        What the page's head says.
    table : ObservationTable
        What was observed.
    summary : CampaignSummary
        Which features are well measured.
    view : ShownView
        One view in full.
    results : tuple of ModelResult
        Models and how well they predict.
    unseen : frozenset of str
        Features that the models have not seen.
    sensor : ActiveSensor or None
        That measured.
    mesh : PartMesh or None
        The part, to be drawn.
    notes : tuple of str
        Further sentences for the summary.
    facts : tuple of (str, str)
        Settings, by name.
    template : str
        The page's template.
    content : dict
        What this template shows beyond that.
    """

    title: str
    lead: str
    table: ObservationTable
    summary: campaign_summary.CampaignSummary
    view: shown_view.ShownView
    results: tuple[campaign_summary.ModelResult, ...] = ()
    unseen: frozenset[str] = frozenset()
    sensor: ActiveSensor | None = None
    mesh: PartMesh | None = None
    notes: tuple[str, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    template: str = "campaign.html"
    content: dict[str, Any] = field(default_factory=dict)

    def html(self) -> str:
        """Return the page: one file that opens without a network; the same report, same page."""
        view = self.view
        return render_page(
            self.template,
            title=self.title,
            lead=self.lead,
            report=self,
            summary=self.summary,
            view=view,
            forecast=view.forecast,
            good=P_NORM_MIN,
            part=part_plot(view, self.mesh, self.unseen),
            exposures=model_figures.exposure_still(self.summary),
            frames=_frames(view),
            close_ups=_close_ups(view, self.unseen),
            choice=model_figures.choice_plot(view, self.unseen),
            forecast_figure=model_figures.forecast_still(view, self.unseen),
            brightness=model_figures.brightness_still(self.table, self.results, self.unseen),
            predictions=[
                plot
                for target in _TARGETS
                if (plot := model_figures.prediction_plot(self.results, target)) is not None
            ],
            reliability=reliability_picture([each.evaluation for each in self.results])
            if self.results
            else None,
            colours=P_NORM_SCALE,
            clipped=CLIPPED,
            missing=NO_POINT,
            **{"view_words": f"view “{view.name}”", **self.content},
        )

    def write(self, folder: str | Path) -> Path:
        """Write the page as ``report.html`` into a folder, and return its path.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        path = make_folder(Path(folder)) / "report.html"
        write_durably(path, self.html().encode())
        return path


def campaign_report(
    source: CaptureSource | ObservationTable,
    models: Sequence[Predictor] = (),
    *,
    unseen: Collection[str] = (),
    mesh: PartMesh | None = None,
    title: str = "",
    notes: Sequence[str] = (),
    progress: Progress = ignore_progress,
) -> CampaignReport:
    """Make the report of a campaign or a table of observations.

    Parameters
    ----------
    source : CaptureSource or ObservationTable
        A campaign, which is observed and brings images, or a table alone.
    models : sequence of Predictor
        Are evaluated on it; with one of each target, and images, a view is forecast, too.
    unseen : collection of str
        Features that the models have not seen; they alone evaluate the models.
    mesh : PartMesh, optional
        The part's surface; without one, the shown view's point cloud stands in.
    title : str, optional
        The page's; the campaign's name by default.
    notes : sequence of str
        Further sentences for the summary.
    progress : Progress
        Receives the captures that are observed.

    Raises
    ------
    ObservationError
        If no feature was measured, or a model has no row to be evaluated on.
    InputError
        If a feature said to be unseen is not in the source.
    """
    campaign = None if isinstance(source, ObservationTable) else source
    table = (
        source
        if isinstance(source, ObservationTable)
        else observe_campaign(source, progress=progress)
    )
    unknown = set(unseen) - set(table.names("feature"))
    if unknown:
        msg = f"unseen features must be in the campaign, got {', '.join(sorted(unknown))}"
        raise InputError(msg)
    summary = campaign_summary.summarise(table)
    view = shown_view.show_view(table, campaign=campaign)
    view = shown_view.with_forecasts(view, shown_view.forecasting_models(models))
    name = title or ("Observations" if campaign is None else campaign.name)
    sensor = None if campaign is None else campaign.sensor
    return CampaignReport(
        title=name,
        lead="Which features are measured well, at which exposure time"
        + (", and what models predict." if models else "."),
        table=table,
        summary=summary,
        view=view,
        results=campaign_summary.evaluate_models(models, table, unseen),
        unseen=frozenset(unseen),
        sensor=sensor,
        mesh=mesh,
        notes=tuple(notes),
        facts=() if sensor is None else sensor_facts(sensor),
    )


def write_campaign_report(
    source: str | Path,
    models: Sequence[str | Path] = (),
    output: str | Path = "report",
    *,
    mesh: str | Path | None = None,
    progress: Progress = ignore_progress,
) -> tuple[CampaignReport, Path]:
    """Write the report of a campaign's folder or a table's file, with models' files.

    Parameters
    ----------
    source : path
        A campaign's folder, or an observation table (``.csv``, ``.parquet``).
    models : sequence of paths
        Files of trained models.
    output : path
        Folder in which ``report.html`` is written; made if it is not there.
    mesh : path, optional
        The part's surface in its own frame, in mm (STL, PLY, OBJ).
    progress : Progress
        Receives what is done.

    Returns
    -------
    CampaignReport, Path
        What the page shows, and where it is.

    Raises
    ------
    MissingFileError, FormatError, DamagedFileError, VersionError
        If a file is missing or not what it should be.
    ObservationError
        As for `campaign_report`.
    """
    source = Path(source)
    loaded = [load_model(Path(path)) for path in models]
    opened: CampaignFolder | ObservationTable
    opened = CampaignFolder(source) if source.is_dir() else read_observations(source)
    surface = None if mesh is None else read_part_mesh(mesh)
    if surface is not None and isinstance(opened, ObservationTable):
        msg = f"{source}: a mesh needs a campaign, which says where the part stands; got a table"
        raise InputError(msg)
    report = campaign_report(opened, loaded, mesh=surface, title=source.stem, progress=progress)
    progress(_STAGE, 0, 1)
    path = report.write(output)
    progress(_STAGE, 1, 1)
    return report, path


def sensor_facts(sensor: ActiveSensor) -> tuple[tuple[str, str], ...]:
    """Return what a page says about a sensor."""
    camera = sensor.camera
    return (
        ("sensor", sensor.name),
        (
            "camera",
            f"{camera.width} × {camera.height} px, focal length {camera.fx:.4g} px, TCP "
            f"{float(sensor.camera_from_tcp.translation_mm[2]):.4g} mm before it",
        ),
    )


def _frames(view: shown_view.ShownView) -> list[pictures.Picture]:
    frames = []
    for index, capture in enumerate(view.captures):
        title = f"{capture.exposure_ms:.4g} ms" + (", emulated" if capture.emulated else "")
        pixels = pictures.ringed_picture(
            pictures.marked_picture(capture), view.views, view.p_norm[:, index]
        )
        alternative = (
            f"Image at {title}; clipped pixels red, pixels without a point blue, rings coloured "
            "by their quality"
        )
        frames.append(pictures.picture(pixels, title, alternative, photo=True))
    return frames


def _close_ups(view: shown_view.ShownView, unseen: frozenset[str]) -> list[pictures.Picture]:
    """Show unseen features close by; without any, those that are measured worst."""
    worst = sorted(range(len(view.features)), key=lambda i: float(view.p_norm[i, view.main]))
    apart = [i for i, name in enumerate(view.features) if name in unseen]
    chosen = sorted((apart or worst)[:_CLOSE_UPS])
    marked = [pictures.marked_picture(capture) for capture in view.captures]
    tiles = []
    for i in chosen if marked else ():
        for index, pixels in enumerate(marked):
            title = f"{view.features[i]}, {view.exposures_ms[index]:.4g} ms: "
            title += f"{rounded(view.p_norm[i, index], 2)} measured"
            if view.forecast is not None:
                taken = view.forecast.taken
                title += (
                    f", {rounded(taken.p_norm[i, index], 2)} predicted (2σ: "
                    f"{rounded(taken.p_norm_low[i, index], 2)} to "
                    f"{rounded(taken.p_norm_high[i, index], 2)})"
                )
            close = pictures.close_picture(pixels, view.views[i], float(view.p_norm[i, index]))
            tiles.append(pictures.picture(close, title, title, photo=False))
    return tiles
