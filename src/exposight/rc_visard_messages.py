"""The messages in which an rc_visard sends its images, and gRPC, which carries them.

Names, numbers and types of the fields are those of the firmware's image interface; the messages are
described at run time, so that no generated file depends on protobuf's version.
"""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

from exposight.errors import SensorError

STREAM_METHOD = "/ImageInterface/StreamImageSets"
"""A request gives a stream of image sets."""

SERVICE, STREAM_NAME = "ImageInterface", "StreamImageSets"

MESSAGE_BYTES = 128_000_000
"""Of an image set at most: 12 megapixels at 8 bits with a disparity image at 16 take 36 MB."""

_TYPES = {"float": 2, "int32": 5, "bool": 8, "string": 9, "bytes": 12, "uint32": 13}
"""Protobuf's numbers of scalar types."""

_MESSAGE = 11

_FIELDS: dict[str, dict[str, tuple[int, str]]] = {
    "Time": {"sec": (1, "int32"), "nsec": (2, "int32")},
    "Gpios": {"inputs": (1, "uint32"), "outputs": (2, "uint32"), "values": (3, "uint32")},
    "Image": {
        "timestamp": (1, "Time"),
        "height": (2, "uint32"),
        "width": (3, "uint32"),
        "focal_length": (4, "float"),
        "principal_point_u": (5, "float"),
        "principal_point_v": (6, "float"),
        "encoding": (7, "string"),
        "is_bigendian": (8, "bool"),
        "step": (9, "uint32"),
        "data": (10, "bytes"),
        "gpios": (11, "Gpios"),
        "exposure_time": (12, "float"),
        "gain": (13, "float"),
    },
    "DisparityImage": {
        "timestamp": (1, "Time"),
        "scale": (2, "float"),
        "offset": (3, "float"),
        "invalid_data_value": (4, "float"),
        "baseline": (5, "float"),
        "delta_d": (6, "float"),
        "image": (7, "Image"),
    },
    "ImageSet": {
        "timestamp": (1, "Time"),
        "left": (2, "Image"),
        "right": (3, "Image"),
        "disparity": (4, "DisparityImage"),
        "disparity_error": (5, "Image"),
        "confidence": (6, "Image"),
    },
    "ImageSetRequest": {
        "left_enabled": (1, "bool"),
        "right_enabled": (2, "bool"),
        "disparity_enabled": (3, "bool"),
        "disparity_error_enabled": (4, "bool"),
        "confidence_enabled": (5, "bool"),
    },
}


@cache
def grpc_library() -> Any:
    """Return gRPC.

    Raises
    ------
    SensorError
        If it is not installed; the message says how to install it.
    """
    return _library("grpc")


@cache
def message_class(name: str) -> Any:
    """Return the class of a message, such as ``ImageSet``.

    Raises
    ------
    SensorError
        If protobuf is not installed; the message says how to install it.
    """
    factory = _library("google.protobuf.message_factory")
    return factory.GetMessageClass(_pool().FindMessageTypeByName(name))


@cache
def _pool() -> Any:
    """Return the messages in a pool of their own: other programs may describe the same names."""
    descriptors = _library("google.protobuf.descriptor_pb2")
    file = descriptors.FileDescriptorProto(name="image_interface.proto", syntax="proto3")
    for name, fields in _FIELDS.items():
        message = file.message_type.add(name=name)
        for field, (number, kind) in fields.items():
            entry = message.field.add(name=field, number=number, label=1)
            entry.type = _TYPES.get(kind, _MESSAGE)
            if entry.type == _MESSAGE:
                entry.type_name = f".{kind}"
    pool = _library("google.protobuf.descriptor_pool").DescriptorPool()
    pool.AddSerializedFile(file.SerializeToString())
    return pool


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        msg = "an rc_visard sends its images by gRPC: pip install 'exposight[rc-visard]'"
        raise SensorError(msg) from error
