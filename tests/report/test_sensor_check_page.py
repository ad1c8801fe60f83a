"""The page of a simulated sensor's check: the same figures, in one file."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import sensor_preset
from exposight.report import sensor_check_page
from exposight.twin.check import CheckedFigure, SensorCheck
from exposight.twin.matt_white import MattWhiteBrightness
from exposight.twin.plates import PlateDepth, RingBrightness
from exposight.twin.sensors import CameraElectronics, FlatFields

NAN = math.nan


def figure(name, measured, expected, tolerance):
    return CheckedFigure(
        name=name, label=f"<{name}>", unit="1", measured=measured, expected=expected,
        tolerance=tolerance,
    )  # fmt: skip


@pytest.fixture
def check():
    share = np.linspace(0.05, 1.04, 28)
    flats = FlatFields(
        share=share, mean=240 * share, variance=0.1 + 4 * share,
        deviation_percent=np.where(share < 0.96, 0.01, NAN), black_level=10.0,
        dark_noise_dn=0.37, dark_noise_e=13.0, is_dark_resolved=False, is_dark_clipped=False,
        dark_current_e_per_s=NAN, gain_dn_per_e=0.018, linearity_error_percent=0.01,
        full_well_e=13_500.0, saturation_e=13_100.0, prnu_percent=0.8, dsnu_e=0.1,
    )  # fmt: skip
    plates = tuple(
        PlateDepth(
            distance_mm=distance, exposure_ms=20.0, grey_levels=90.0, covered_share=1.0,
            points_share=0.99, median_error_mm=0.05, bias_mm=0.001, noise_mm=0.07,
            repeat_noise_mm=0.06, predicted_noise_mm=0.0612,
        )
        for distance in (400.0, 600.0, 800.0)
    )  # fmt: skip
    return SensorCheck(
        sensor=sensor_preset("comet-pro-ae"),
        electronics=CameraElectronics(),
        flat_fields=flats,
        matt_white=MattWhiteBrightness(
            grey_levels_per_ms=1.5, expected_per_ms=1.49, clips_at_ms=84.0
        ),
        plates=plates,
        ring=RingBrightness(
            exposure_ms=np.array([5.0, 20.0, 80.0, 300.0]),
            i_avg=np.array([12.0, 24.0, 90.0, 160.0]),
            p_norm=np.array([0.0, 1.0, 1.0, 0.0]),
        ),
        figures=(
            figure("system_gain_dn_per_e", 0.01815, 0.01814, 0.0002),
            figure("prnu_percent", 0.81, 0.80, 0.03),
            figure("dark_current_e_per_s", NAN, 125.0, 12.5),
            figure("linearity_error_percent", 0.01, 0.0, 0.5),
            figure("matt_white_grey_levels_per_ms", 1.5, 1.49, 0.04),
            figure("depth_noise_mm_at_600_mm", 0.06, 0.0612, 0.006),
        ),
        remarks=("A remark on p_norm & <all>.",),
    )


def shown_rows(reader, page):
    rows = reader(page).rows
    return {name: [[cell["text"] for cell in row] for row in rows[name]] for name in rows}


def test_the_page_says_what_was_measured(check, reader):
    page = sensor_check_page(check)
    assert "The simulated sensor does what its table says: all 5 figures agree." in page
    rows = shown_rows(reader, page)
    assert [row[1:] for row in rows["camera"][1:3]] == [
        ["0.01815", "0.01814", "agrees", "+0.06 %", "± 1.1 %"],
        ["0.8100", "0.8000", "agrees", "+1.25 %", "± 3.8 %"],
    ]
    assert rows["camera"][3][1:] == ["–", "125.0", "open", "–", "–"]
    assert rows["plates"][2][:3] == ["600", "20.0", "90"]
    assert {row[-1] for row in rows["plates"][1:]} == {"agrees"}
    assert "A remark on <i>p</i><sub>norm</sub> &amp; &lt;all&gt;." in page
    assert ">21 to 108<" in page  # where p_norm passes 0.75, between its neighbours


def test_a_deviation_is_the_first_thing_that_the_page_says(check, reader):
    off = figure("depth_noise_mm_at_600_mm", 0.09, 0.0612, 0.006)
    page = sensor_check_page(replace(check, figures=(*check.figures[:-1], off)))
    assert 'class="statement no">The simulated sensor deviates' in page
    assert [row[-1] for row in shown_rows(reader, page)["plates"][1:]] == [
        "agrees",
        "deviates",
        "agrees",
    ]


def test_the_page_needs_no_other_file(check):
    page = sensor_check_page(check)
    assert page == sensor_check_page(check)
    assert not re.search(r"(?:https?:)?//[\w-]+\.\w", page)
    assert not re.search(r"<(?:link|script|img|iframe)\b", page)


def test_what_could_not_be_measured_leaves_gaps(check):
    empty = RingBrightness(exposure_ms=np.empty(0), i_avg=np.empty(0), p_norm=np.empty(0))
    blind = replace(
        check.plates[1], points_share=0.0, median_error_mm=NAN, bias_mm=NAN, noise_mm=NAN,
        repeat_noise_mm=NAN, predicted_noise_mm=NAN,
    )  # fmt: skip
    coarse = replace(
        check.flat_fields, gain_dn_per_e=NAN, dark_noise_e=NAN, dark_noise_dn=NAN, saturation_e=NAN
    )
    white = replace(check.matt_white, clips_at_ms=NAN)
    page = sensor_check_page(
        replace(check, ring=empty, plates=(blind,) * 3, flat_fields=coarse, matt_white=white)
    )
    assert "No exposure time clips it." in page
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
