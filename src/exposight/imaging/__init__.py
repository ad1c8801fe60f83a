"""From recorded frames to projector coordinates, and from these to organised clouds."""

from exposight.imaging.capture_files import CaptureForm
from exposight.imaging.codings import Fringe, GrayCode
from exposight.imaging.decoded import DecodedMap, DecodingCounts, DecodingLimits, PixelFlag
from exposight.imaging.decoding import decode, read_recording
from exposight.imaging.frame_files import Alignment, Channel, read_frames
from exposight.imaging.frames import FrameStack, re_expose
from exposight.imaging.map_files import read_map, write_map
from exposight.imaging.merging import MergeRecord, merge_captures, merge_record
from exposight.imaging.noise import (
    GreyNoise,
    noise_of_frames,
    recorded_sigma_z,
    why_no_sigma,
    with_sigma_z,
)
from exposight.imaging.rectification import RectifiedPair, rectify
from exposight.imaging.sequence_files import (
    SEQUENCE_PRESETS,
    read_sequence,
    sequence_named_or_read,
    sequence_to_toml,
)
from exposight.imaging.sequences import AxisCoding, PatternSequence
from exposight.imaging.stacks import mean_image, stack_images, window_images
from exposight.imaging.stereo import StereoLimits, match_pair, stereo_by_images
from exposight.imaging.stereo_codes import match_codes, stereo_by_codes
from exposight.imaging.stereo_match import MatchOutcome, StereoMatch
from exposight.imaging.triangulation import triangulate
