"""Figures and tables of trained models: what they predict beside what was measured."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from markupsafe import escape
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from exposight.models import I_AVG_MIN, P_NORM_MIN, Evaluation
from exposight.observing import ObservationTable
from exposight.planning import DEFAULT_MODELS, Forecast
from exposight.quantities import QUANTITIES, quantity
from exposight.report import campaign_summary, shown_view
from exposight.report.figures import Plot, Still, axis, draw_still, label_panel, layout, plain_axes
from exposight.report.palette import ACCENT, EXPOSURE_SCALE, INK, MUTED, OUTSIDE, P_NORM_SCALE, rgb
from exposight.report.part_plot import feature_title

_BRIGHTNESS_MODEL = "q_k1"
_GREY_LEVELS = np.linspace(0.0, 255.0, 511)
_NOT_MEASURED = "#f0f2f4"
_NAMED = 45
"""More features than these have no names beside their rows."""
_PANELS = 4
"""So many panels of a forecast stand side by side."""
_TICKS_MS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000]


def exposure_still(summary: campaign_summary.CampaignSummary) -> Still:
    """Draw each feature's p_norm at each exposure time, and above how many reach `P_NORM_MIN`."""
    names = [feature.name for feature in summary.features]
    rows, columns = summary.p_norm.shape
    named = rows <= _NAMED

    def draw(figure: Figure) -> None:
        top, map_ = figure.subplots(
            2, 1, sharex=True, height_ratios=(1.2, max(2.2, 0.19 * rows if named else 4.0))
        )
        places = np.arange(columns)
        colours = [ACCENT if place == summary.best else "#b9cfd5" for place in places]
        top.bar(places, summary.good, width=0.82, color=colours)
        top.set_ylim(0, 1.18 * max(1, rows))
        top.axhline(rows, color=MUTED, linewidth=0.8, linestyle=":")
        plain_axes(top, "", "features")
        label_panel(
            top,
            f"{QUANTITIES['p_norm'].math} ≥ {P_NORM_MIN:g}: {summary.good[summary.best]} of {rows} "
            f"at {summary.exposures_ms[summary.best]:.4g} ms",
        )
        scale = LinearSegmentedColormap.from_list("p_norm", P_NORM_SCALE, bad=_NOT_MEASURED)
        order = slice(None) if named else np.argsort(np.nanmean(summary.p_norm, axis=1))[::-1]
        image = map_.imshow(
            summary.p_norm[order], cmap=scale, vmin=0, vmax=1, aspect="auto",
            interpolation="nearest",
        )  # fmt: skip
        every = -(-columns // 16)
        map_.set_xticks(places[::every], [f"{t:.3g}" for t in summary.exposures_ms[::every]])
        map_.set_yticks(range(rows), names) if named else map_.set_yticks([])
        map_.tick_params(length=0)
        map_.spines[:].set_visible(False)
        map_.set_xlabel(QUANTITIES["exposure_ms"].axis_math)
        map_.set_ylabel("" if named else f"{rows} features, best first")
        figure.colorbar(
            image, ax=[top, map_], label=QUANTITIES["p_norm"].axis_math, shrink=0.7, aspect=30
        )

    height = 2.2 + (0.19 * rows if named else 3.4)
    title = "Best quality of each feature at each exposure time"
    return draw_still("exposures", title, (8.2, height), draw)


def brightness_still(
    table: ObservationTable, results: Sequence[campaign_summary.ModelResult], unseen: frozenset[str]
) -> Still:
    """Draw p_norm over i_avg: every observation, and what the one-dimensional model learnt."""
    rows = table.measured()
    values = rows.array(["i_avg", "p_norm", "exposure_ms"])
    apart = np.isin(rows.names("feature"), list(unseen))
    model = next((result.model for result in results if result.name == _BRIGHTNESS_MODEL), None)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        if model is not None:
            prediction = model.predict(i_avg=_GREY_LEVELS)
            axes.fill_between(
                _GREY_LEVELS, prediction.low, prediction.high, color=ACCENT, alpha=0.14,
                linewidth=0, label="±2σ of a new observation",
            )  # fmt: skip
        scale = LinearSegmentedColormap.from_list("exposure", EXPOSURE_SCALE)
        kinds = ((~apart, "o", "features that trained" if apart.any() else "observations"),)
        for mask, mark, title in (*kinds, (apart, "D", "unseen features")):
            if not mask.any():
                continue
            dots = axes.scatter(
                values[mask, 0], values[mask, 1], c=np.log10(values[mask, 2]), cmap=scale,
                vmin=np.log10(values[:, 2].min()), vmax=np.log10(values[:, 2].max()),
                s=11, marker=mark, alpha=0.6, linewidth=0, label=title, rasterized=True,
            )  # fmt: skip
        if model is not None:
            axes.plot(
                _GREY_LEVELS, prediction.mean, color=ACCENT, linewidth=2.4,
                label="mean of the brightness model",
            )  # fmt: skip
        axes.axvline(I_AVG_MIN, color=MUTED, linewidth=0.9, linestyle=":")
        axes.axhline(P_NORM_MIN, color=MUTED, linewidth=0.9, linestyle="--")
        axes.set_xlim(0, 258)
        axes.set_ylim(-0.05, 1.25)
        plain_axes(axes, QUANTITIES["i_avg"].axis_math, QUANTITIES["p_norm"].axis_math)
        bar = figure.colorbar(dots, label=QUANTITIES["exposure_ms"].axis_math)
        ticks = [tick for tick in _TICKS_MS if values[:, 2].min() <= tick <= values[:, 2].max()]
        bar.set_ticks(np.log10(ticks).tolist(), labels=[f"{tick:g}" for tick in ticks])
        figure.legend(loc="outside lower center", ncols=4, markerscale=1.6)

    return draw_still("brightness", "Quality over brightness", (8.2, 4.4), draw)


def choice_plot(view: shown_view.ShownView, unseen: frozenset[str]) -> Plot | None:
    """Draw forecast quality over exposure time, and what was measured; None without a forecast."""
    if view.forecast is None:
        return None
    choice = view.forecast.choice
    opacity = 0.35 if len(choice.features) <= _NAMED else 0.12
    drawing = go.Figure()
    for name, p_norm in zip(choice.features, choice.p_norm, strict=True):
        drawing.add_scatter(
            x=choice.exposures_ms,
            y=p_norm.astype(np.float32),
            mode="lines",
            line={
                "color": f"rgba(11, 100, 119, {opacity})",
                "width": 1.4,
                "dash": "dot" if name in unseen else "solid",
            },
            name=feature_title(name, unseen),
            hovertemplate="%{y:.2f} at %{x:.4g} ms",
            showlegend=False,
        )
    for forecast, style in zip(view.forecasts, _MEANS, strict=False):
        drawing.add_scatter(
            x=forecast.choice.exposures_ms,
            y=forecast.choice.p_norm.mean(axis=0),
            name=f"predicted by {forecast.quality} and {forecast.exposure}, mean over features",
            hovertemplate="%{y:.3f} at %{x:.4g} ms",
            mode="lines",
            line=style,
        )
    drawing.add_scatter(
        x=view.exposures_ms,
        y=np.nanmean(view.p_norm, axis=0),
        name="measured, mean over features",
        hovertemplate="%{y:.3f} at %{x:.4g} ms",
        mode="markers",
        marker={"color": INK, "size": 11, "symbol": "diamond"},
    )
    best_ms = choice.best_exposure_ms()
    drawing.add_vline(x=best_ms, line={"color": MUTED, "width": 1, "dash": "dash"})
    drawing.update_layout(
        layout(
            xaxis=axis("exposure time (ms)", type="log", tickvals=_TICKS_MS, ticktext=_TICKS_MS),
            yaxis=axis(QUANTITIES["p_norm"].axis_html, range=[-0.05, 1.1]),
        )
    )
    return Plot.of("choice", drawing)


_MEANS = ({"color": ACCENT, "width": 3.5}, {"color": OUTSIDE, "width": 2, "dash": "dash"})
"""How the mean of each pair of models is drawn."""

_BANDS = ((ACCENT, "#7fb1bb", -0.16), (OUTSIDE, "#f2c89b", 0.16))
"""Colours of dots and bands of each pair of models, and their place beside a feature's row."""


def forecast_still(view: shown_view.ShownView, unseen: frozenset[str]) -> Still | None:
    """Draw predicted and measured p_norm of each feature of a view; None without a forecast."""
    if view.forecast is None:
        return None
    places = np.arange(len(view.features))
    named = len(places) <= _NAMED

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(view.exposures_ms), sharex=True, sharey=True, squeeze=False)
        for index, axes in enumerate(panels[0]):
            order = places if named else np.argsort(view.p_norm[:, index])[::-1]
            for forecast, (colour, band, aside) in zip(view.forecasts, _BANDS, strict=False):
                taken = forecast.taken
                middle, low, high = (
                    values[order, index]
                    for values in (taken.p_norm, taken.p_norm_low, taken.p_norm_high)
                )
                axes.errorbar(
                    middle, places + aside * named, xerr=np.abs([middle - low, high - middle]),
                    fmt="o", color=colour, ecolor=band, elinewidth=3.5 if named else 0.6,
                    markersize=4 if named else 2,
                    label=f"predicted by {forecast.quality} and {forecast.exposure}, 2σ band",
                )  # fmt: skip
            axes.plot(
                view.p_norm[order, index], places, "D", color=INK, markersize=4.5 if named else 2,
                label="measured",
            )  # fmt: skip
            plain_axes(axes, QUANTITIES["p_norm"].axis_math, "")
            axes.set_xlim(-0.06, 1.12)
            axes.set_xticks([0, 0.5, 1])
            label_panel(axes, f"{view.exposures_ms[index]:.4g} ms")
        axes.set_ylim(len(places) - 0.5, -0.5)
        axes.set_yticks(places if named else [], view.features if named else [])
        for label, name in zip(panels[0, 0].get_yticklabels(), view.features, strict=False):
            label.set_fontweight("bold" if name in unseen else "normal")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)

    height = 1.3 + (0.24 * len(places) if named else 5.0)
    title = "Predicted and measured quality of each feature"
    return draw_still("forecast", title, (8.2, height), draw)


def forecast_picture(forecast: Forecast) -> Still:
    """Draw p_norm and its 2σ band over exposure time, each feature in a panel of its own."""
    columns = min(_PANELS, len(forecast.features))
    rows = -(-len(forecast.features) // columns)
    low, high = forecast.p_norm_low, forecast.p_norm_high
    times = forecast.exposures_ms
    ticks = [tick for tick in _TICKS_MS if min(times) <= tick <= max(times)]
    ticks = ticks[:: max(1, -(-len(ticks) // _PANELS))]
    time, good = QUANTITIES["exposure_ms"], QUANTITIES["p_norm"]

    def draw(figure: Figure) -> None:
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for i, axes in enumerate(panels.flat):
            if i >= len(forecast.features):
                axes.set_axis_off()
                continue
            axes.fill_between(times, low[i], high[i], color="#cfe1e5", lw=0)
            axes.plot(times, forecast.p_norm[i], color=ACCENT)
            axes.axhline(forecast.need, color=MUTED, linewidth=0.8, linestyle=":")
            lowest, first = i >= len(forecast.features) - columns, i % columns == 0
            plain_axes(axes, time.axis_math * lowest, good.axis_math * first)
            axes.set(xscale="log", ylim=(-0.05, 1.1), title=forecast.features[i])
            axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            axes.minorticks_off()

    title = "Predicted quality over exposure time"
    return draw_still("forecasts", title, (2.0 * columns + 0.6, 1.5 * rows + 0.6), draw)


def prediction_plot(results: Sequence[campaign_summary.ModelResult], target: str) -> Plot | None:
    """Draw predicted over observed values, a menu of models; None if none predicts the target."""
    results = [result for result in results if result.model.target == target]
    if not results:
        return None
    names = [result.name for result in results]
    chosen = next((name for name in DEFAULT_MODELS if name in names), names[-1])
    shown = quantity(target)
    drawing = go.Figure()
    observed = np.concatenate([result.evaluation.observed for result in results])
    ends = [min(0.0, float(observed.min())), float(observed.max()) * 1.02]
    drawing.add_scatter(
        x=ends,
        y=ends,
        mode="lines",
        line={"color": MUTED, "width": 1, "dash": "dash"},
        name="predicted = observed",
        hoverinfo="skip",
    )
    for result in results:
        for inside in (True, False):
            _add_predictions(drawing, result.evaluation, shown.suffix, result.name, inside, chosen)
    drawing.update_layout(
        layout(
            xaxis=axis(f"observed {shown.axis_html}"), yaxis=axis(f"predicted {shown.axis_html}")
        )
    )
    return Plot.of(
        f"predicted-{target}",
        drawing,
        menu=f"model of the {shown.name}",
        choices={result.name: f"{result.name} – {result.model.title}" for result in results},
        chosen=chosen,
    )


def _add_predictions(
    drawing: go.Figure, evaluation: Evaluation, unit: str, name: str, inside: bool, chosen: str
) -> None:
    prediction = evaluation.prediction
    mask = prediction.inside == inside
    if not mask.any():
        return
    colour = ACCENT if inside else OUTSIDE
    red, green, blue = rgb(colour)
    rows = evaluation.table.where(mask)
    exposures = rows.array(["exposure_ms"])[:, 0]
    least = quantity(evaluation.model.target).low
    low = np.maximum(prediction.low, -np.inf if least is None else least)
    drawing.add_scatter(
        x=evaluation.observed[mask].astype(np.float32),
        y=prediction.mean[mask].astype(np.float32),
        error_y={
            "array": (prediction.high - prediction.mean)[mask].astype(np.float32),
            "arrayminus": np.maximum(prediction.mean - low, 0.0)[mask].astype(np.float32),
            "thickness": 0.8,
            "width": 0,
            "color": f"rgba({red},{green},{blue},0.2)",
        },
        mode="markers",
        marker={"color": colour, "size": 5, "symbol": "circle" if inside else "diamond-open"},
        name="inside range" if inside else "outside",
        text=[
            f"{escape(feature)}, {exposure:.4g} ms"
            for feature, exposure in zip(rows.names("feature"), exposures, strict=True)
        ],
        hovertemplate=(
            f"<b>%{{text}}</b><br>observed %{{x:.4g}} {unit}<br>"
            f"predicted %{{y:.4g}} ± %{{error_y.array:.2g}} {unit}<extra></extra>"
        ),
        meta=name,
        visible=name == chosen,
    )
