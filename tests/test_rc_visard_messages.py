"""The messages of an rc_visard's images, and what is said where gRPC is not installed."""

import sys

import pytest

from exposight import rc_visard_messages
from exposight.errors import SensorError


@pytest.mark.parametrize("module", ["grpc", "google.protobuf.message_factory"])
def test_what_is_missing_is_said_with_how_to_install_it(monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    library = rc_visard_messages._library
    with pytest.raises(SensorError, match=r"pip install 'exposight\[rc-visard\]'"):
        library(module)


def test_bytes_on_the_wire_are_of_the_interface_s_numbers():
    pytest.importorskip("google.protobuf")
    image_set = rc_visard_messages.message_class("ImageSet")()
    image_set.disparity.baseline = 0.5
    # field 4, 5 bytes: field 5, a float
    assert image_set.SerializeToString() == bytes.fromhex("22052d0000003f")
    request = rc_visard_messages.message_class("ImageSetRequest")(
        left_enabled=True, disparity_enabled=True
    )
    assert request.SerializeToString() == bytes.fromhex("08011801")
