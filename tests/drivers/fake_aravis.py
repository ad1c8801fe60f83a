"""What of Aravis a camera uses, in Python: for what the real fake camera cannot do."""

from __future__ import annotations

from enum import Enum
from types import SimpleNamespace

import numpy as np


class FakeError(Exception):
    """In place of GLib.Error."""


class BufferStatus(Enum):
    SUCCESS = 0
    MISSING_PACKETS = 1

    @property
    def value_nick(self):
        return self.name.lower()


MONO_8 = 0x01080001
LIBRARY = SimpleNamespace(
    BufferStatus=BufferStatus,
    RegisterCachePolicy=SimpleNamespace(DISABLE="disable"),
    RangeCheckPolicy=SimpleNamespace(ENABLE="enable"),
    Buffer=SimpleNamespace(new_allocate=lambda size: size),
    PIXEL_FORMAT_MONO_8=MONO_8,
    PIXEL_FORMAT_MONO_10=2,
    PIXEL_FORMAT_MONO_12=3,
    PIXEL_FORMAT_MONO_14=4,
    PIXEL_FORMAT_MONO_16=5,
)


class FakeBuffer:
    def __init__(self, image, status=BufferStatus.SUCCESS, taken_us=None, kind=MONO_8):
        self.image, self.status, self.taken_us, self.kind = image, status, taken_us, kind

    def get_status(self):
        return self.status

    def get_image_height(self):
        return self.image.shape[0]

    def get_image_width(self):
        return self.image.shape[1]

    def get_image_pixel_format(self):
        return self.kind

    def get_image_data(self):
        return self.image.tobytes()


class FakeCamera:
    """A camera whose frames' grey level is their exposure time in ms; a new one holds later."""

    def __init__(self, *, feature="ExposureTime", bounds=(100.0, 1_000_000.0), chunks=False):
        self.values = {
            feature: 5000.0,
            "ExposureAuto": "Continuous",
            "GainAuto": "Off",
            "TriggerMode": "On",
        }
        self.feature, self.bounds, self.chunks = feature, bounds, chunks
        self.rounds = lambda us: us
        self.status, self.silent, self.unplugged = [], 0, False
        self.lag, self.pending = 1, []
        self.shown_us, self.taken, self.policies = 5000.0, 0, []
        self.on_lost = None
        self.running = False

    # -- device
    def get_device(self):
        return self

    def connect(self, signal, call):
        assert signal == "control-lost"
        self.on_lost = call

    def set_register_cache_policy(self, policy):
        self.policies.append(policy)

    set_range_check_policy = set_register_cache_policy

    def _answering(self):
        if self.unplugged:
            raise FakeError("GigEVision read_register timeout")

    # -- features
    def is_feature_available(self, name):
        self._answering()
        return name in self.values

    def _get(self, name):
        self._answering()
        if name not in self.values:
            raise FakeError(f"node {name} not found")
        return self.values[name]

    get_float = get_string = get_boolean = _get

    def set_string(self, name, value):
        self._get(name)
        self.values[name] = value

    set_boolean = set_string

    def set_float(self, name, value):
        self._get(name)
        assert self.bounds[0] <= value <= self.bounds[1]
        self.values[name] = self.rounds(value)
        self.pending = [self.lag, self.values[name]]

    def get_float_bounds(self, name):
        self._get(name)
        return self.bounds

    def get_float_increment(self, name):
        raise FakeError(f"{name} has no increment")

    def get_vendor_name(self):
        raise FakeError("no vendor")

    def get_model_name(self):
        return "fake"

    def get_device_serial_number(self):
        return "7"

    # -- chunks
    def are_chunks_available(self):
        self.values.setdefault("ChunkModeActive", False)
        return self.chunks

    def set_chunks(self, names):
        assert names == "ExposureTime"
        self.values["ChunkModeActive"] = True

    def create_chunk_parser(self):
        return SimpleNamespace(get_float_value=lambda buffer, _: buffer.taken_us)

    # -- stream
    def create_stream(self, _call, _data):
        return self

    def get_payload(self):
        self._answering()
        return 12

    def push_buffer(self, _buffer):
        pass

    def start_acquisition(self):
        self._answering()
        assert self.values["TriggerMode"] == "Off"
        self.running = True

    def stop_acquisition(self):
        self._answering()
        self.running = False

    def try_pop_buffer(self):
        return None

    def timeout_pop_buffer(self, _timeout_us):
        assert self.running
        if self.silent:
            self.silent -= 1
            return None
        self.taken += 1
        if self.pending:
            if self.pending[0] == 0:
                self.shown_us, self.pending = self.pending[1], []
            else:
                self.pending[0] -= 1
        image = np.full((3, 4), round(self.shown_us / 1000.0), dtype=np.uint8)
        status = self.status.pop(0) if self.status else BufferStatus.SUCCESS
        return FakeBuffer(image, status, self.shown_us)
