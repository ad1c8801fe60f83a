import pytest

from exposight.errors import did_you_mean

SENSORS = ("comet-pro-ae", "rc-visard-65")


@pytest.mark.parametrize("typed", ["comet-pro", "comet_pro_ae", "COMET-PRO-AE", "commet-pro-ae"])
def test_a_name_that_is_nearly_right(typed):
    assert did_you_mean(typed, SENSORS) == "; did you mean 'comet-pro-ae'?"


def test_a_name_like_none():
    assert did_you_mean("kinect", SENSORS) == ""


def test_no_names_at_all():
    assert did_you_mean("kinect", ()) == ""
