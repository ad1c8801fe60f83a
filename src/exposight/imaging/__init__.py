"""From recorded frames to projector coordinates, and from these to organised clouds."""

from exposight.imaging.agreement import CloudAgreement, compare_along_rays
from exposight.imaging.decoded import DecodedMap, DecodingCounts, DecodingLimits, PixelFlag
from exposight.imaging.decoding import decode, read_recording
from exposight.imaging.frames import BitDepth, FrameStack, check_frames, read_frames
from exposight.imaging.phase_shift import phase_and_modulation, unwrap_step
from exposight.imaging.re_exposure import re_expose
from exposight.imaging.rectification import RectifiedPair, rectify
from exposight.imaging.sequence_file import read_sequence, sequence_named_or_read, sequence_to_toml
from exposight.imaging.sequences import (
    SEQUENCE_PRESETS,
    Fringe,
    GrayCode,
    PatternSequence,
    PhaseShift,
    sequence_preset,
)
from exposight.imaging.stereo import StereoLimits, match_pair, matchable
from exposight.imaging.triangulation import triangulate
