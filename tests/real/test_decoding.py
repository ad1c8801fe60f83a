"""Decoding of recorded frames, against what is known about each recording."""

import dataclasses

import cv2
import numpy as np
import pytest
from benchmarks.agreement import compare_along_rays
from scipy.io import loadmat

from exposight.errors import ContradictionError
from exposight.geometry import read_projector_camera
from exposight.imaging import (
    PixelFlag,
    decode,
    re_expose,
    read_recording,
    sequence_named_or_read,
    triangulate,
)


@pytest.fixture(scope="module")
def skull(real_data):
    """Return the rig, and the cloud that comes with the recording: (1352, 1688, 3) mm, with NaN."""
    rig = read_projector_camera(real_data / "skull" / "calibration.xml")
    return rig, loadmat(real_data / "skull" / "skull_gray" / "pointCloud.mat")["xyz"]


@pytest.fixture(scope="module")
def skull_stacks(real_data):
    return {
        name: read_recording(real_data / "skull" / name, sequence_named_or_read(name))
        for name in ("skull_gray", "skull_2x3")
    }


def cloud_of(rig, decoded):
    return triangulate(
        decoded, camera=rig.camera, projector=rig.projector,
        projector_from_camera=rig.projector_from_camera,
    )  # fmt: skip


def without_projector_distortion(rig):
    return dataclasses.replace(rig, projector=dataclasses.replace(rig.projector, distortion=()))


# The authors' points lie on rays through the undistorted image's pixel rows, and on columns at
# 2k + 1.5 px of a projector without distortion: they left that distortion out. Some 0.06 mm of the
# median distance to clouds that take it into account is this.


def test_skull_gray_code_agrees_with_the_authors_cloud(skull, skull_stacks):
    rig, reference = skull
    decoded = decode(skull_stacks["skull_gray"], sequence_named_or_read("skull_gray"))
    agreement = compare_along_rays(cloud_of(rig, decoded), reference, rig.camera)
    assert agreement.common_points >= 85000
    assert agreement.median_mm <= 0.12
    assert agreement.p90_mm <= 0.45


def test_skull_gray_code_without_projector_distortion_is_the_authors(skull, skull_stacks):
    rig, reference = skull
    decoded = decode(skull_stacks["skull_gray"], sequence_named_or_read("skull_gray"))
    cloud = cloud_of(without_projector_distortion(rig), decoded)
    agreement = compare_along_rays(cloud, reference, rig.camera)
    assert agreement.median_mm <= 0.04
    assert agreement.p90_mm <= 0.2


def test_skull_phase_shift_agrees_with_the_authors_cloud(skull, skull_stacks):
    rig, reference = skull
    decoded = decode(skull_stacks["skull_2x3"], sequence_named_or_read("skull_2x3"))
    agreement = compare_along_rays(cloud_of(rig, decoded), reference, rig.camera)
    assert agreement.common_points >= 85000
    assert agreement.median_mm <= 0.25
    assert agreement.p90_mm <= 0.7


def test_skull_gray_code_and_phase_shift_agree(skull_stacks):
    gray = decode(skull_stacks["skull_gray"], sequence_named_or_read("skull_gray"))
    phase = decode(skull_stacks["skull_2x3"], sequence_named_or_read("skull_2x3"))
    difference = (gray.column - phase.column)[gray.valid & phase.valid]
    # A wrong convention would show as half a projector pixel or more.
    assert abs(np.median(difference)) < 0.3
    assert np.median(np.abs(difference)) < 0.5


def test_frames_in_the_wrong_order_are_noticed(skull_stacks):
    """With fine and coarse fringes swapped, most pixels contradict themselves."""
    sequence = sequence_named_or_read("skull_2x3")
    coarse, fine = sequence.columns.fringes
    swapped = dataclasses.replace(
        sequence.columns,
        fringes=(
            dataclasses.replace(coarse, frames=fine.frames),
            dataclasses.replace(fine, frames=coarse.frames),
        ),
    )
    stack = skull_stacks["skull_2x3"]
    right = decode(stack, sequence).counts()
    wrong_sequence = dataclasses.replace(sequence, columns=swapped)
    with pytest.raises(ContradictionError, match="fringe-order"):
        decode(stack, wrong_sequence)
    wrong = decode(stack, wrong_sequence, despite=["fringe-order"]).counts()
    assert wrong.ambiguous > 10 * right.ambiguous


PUBLISHED_GREY = (8.9, 17.8, 31.0, 44.5, 67.0, 89.0, 128.0, 171.0, 199.0)
PUBLISHED_SHARE = (0.15, 0.85, 0.98, 1.0, 1.0, 0.99, 0.51, 0.11, 0.02)


@pytest.mark.slow
def test_re_exposure_keeps_the_known_share_of_points(skull, skull_stacks):
    """A point counts within 1.5 mm of the authors' point of the same pixel, as in the table."""
    rig, reference = skull
    stack, sequence = skull_stacks["skull_2x3"], sequence_named_or_read("skull_2x3")
    on_object = decode(stack, sequence).valid & np.isfinite(reference[..., 0])
    grey, kept = [], []
    for factor in (0.2, 0.4, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0):
        exposed = re_expose(stack, factor)
        cloud = cloud_of(rig, decode(exposed, sequence))
        distance = np.linalg.norm(cloud.points - reference, axis=-1)
        grey.append(exposed.frames[:, on_object].mean())
        kept.append(np.count_nonzero(distance <= 1.5))
    share = np.interp(PUBLISHED_GREY, grey, np.array(kept) / kept[3])
    assert share == pytest.approx(PUBLISHED_SHARE, abs=0.05)


def test_board_is_a_homography(real_data):
    sequence = sequence_named_or_read("board")
    decoded = decode(read_recording(real_data / "board" / "capture_0", sequence), sequence)
    on_board = np.zeros(decoded.image_shape, dtype=bool)
    on_board[205:760, 250:950] = True  # the printed checkerboard
    v, u = np.nonzero(on_board & decoded.valid)
    pixels = np.column_stack([u, v]).astype(np.float64)
    projected = np.column_stack([decoded.column[v, u], decoded.row[v, u]])
    homography, _ = cv2.findHomography(pixels, projected, cv2.RANSAC, 3.0)
    fitted = cv2.perspectiveTransform(pixels[None], homography)[0]
    error = np.linalg.norm(fitted - projected, axis=1)
    assert len(error) > 200_000
    assert np.median(error) <= 0.25
    assert np.mean(error <= 3.0) >= 0.999


@pytest.fixture(scope="module")
def foam(real_data):
    sequence = sequence_named_or_read("foam")
    return decode(read_recording(real_data / "foam" / "object1", sequence), sequence)


@pytest.mark.parametrize("axis", ["column", "row"])
def test_foam_is_smooth_on_the_wall(foam, axis):
    """The display was not linearised, which leaves a ripple of 4 % of the finest fringe."""
    wall = getattr(foam, axis)[30:150, 1150:1500]
    y, x = np.mgrid[: wall.shape[0], : wall.shape[1]].reshape(2, -1)
    design = np.column_stack([np.ones_like(x), x, y, x * x, y * y, x * y])
    fit, *_ = np.linalg.lstsq(design, wall.ravel())
    residual = wall.ravel() - design @ fit
    assert residual.std() < 3.0
    assert np.abs(residual).max() < 6.0


def test_foam_is_decoded_nearly_everywhere_it_is_lit(foam):
    lit = ~foam.flagged(PixelFlag.LOW_MODULATION)
    assert np.mean(foam.valid[lit]) > 0.99
    assert foam.flagged(PixelFlag.AMBIGUOUS).mean() < 0.01
