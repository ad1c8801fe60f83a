"""A model's file: the same predictions, the same bytes, and a clear word for everything else."""

import hashlib
import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from exposight.errors import (
    DamagedFileError,
    FileError,
    FormatError,
    MissingFileError,
    VersionError,
)
from exposight.gp import GaussianProcess
from exposight.models import (
    MODELS,
    is_model_file,
    load_model,
    model_named,
    model_sha256,
    save_model,
)

DIGEST_LENGTH = 64

POSE_TOLERANCE = 1e-12
"""Reading a pose makes its rotation exactly orthonormal: a few roundings of 1e-16."""


@pytest.fixture
def path(tmp_path):
    return tmp_path / "q_k2.exposight-model"


@pytest.fixture
def saved(path, trained, wide_sensor):
    """The file of a small model, with a sensor in it."""
    save_model(path, trained(model_named("q_k2"), sensor=wide_sensor))
    return path


def rewrite(path, *, document=None, members=None):
    """Change a model's document or members, and seal it with the right checksum."""
    with zipfile.ZipFile(path) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    if document is not None:
        fields = json.loads(content["model.json"])
        document(fields)
        content["model.json"] = json.dumps(fields).encode()
    content.update(members or {})
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in content.items():
            if data is not None:
                archive.writestr(name, data)
        archive.comment = b"0" * DIGEST_LENGTH
    sealed = buffer.getvalue()[:-DIGEST_LENGTH]
    path.write_bytes(sealed + hashlib.sha256(sealed).hexdigest().encode())


def npy(array):
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


# -- round trips --------------------------------------------------------------------------------


@pytest.mark.parametrize("specification", MODELS, ids=lambda model: model.name)
def test_a_read_model_predicts_the_same_bits(path, trained, make_table, specification):
    model = trained(specification)
    save_model(path, model)
    again = load_model(path)
    unseen = make_table(50, seed=3)
    before, after = model.predict(unseen), again.predict(unseen)
    np.testing.assert_array_equal(after.mean, before.mean)
    np.testing.assert_array_equal(after.std, before.std)
    np.testing.assert_array_equal(after.inside, before.inside)


def test_everything_in_a_model_comes_back(path, trained):
    model = trained(model_named("e_k6"))
    save_model(path, model)
    again = load_model(path)
    assert again.sensor is None
    assert again.summary == model.summary
    assert again.provenance == model.provenance
    assert again.process.kernel == model.process.kernel
    assert again.process.noise_variance == model.process.noise_variance
    np.testing.assert_array_equal(again.process.x, model.process.x)
    np.testing.assert_array_equal(again.process.y, model.process.y)
    for name in ("name", "title", "target", "inputs", "p_norm_min", "source"):
        assert getattr(again, name) == getattr(model, name)


def test_noise_of_single_rows_comes_back(path, trained):
    model = trained(model_named("q_k4"))
    process, noise = model.process, np.linspace(0.0, 0.1, model.n_observations)
    noisy = GaussianProcess.condition(
        process.kernel, process.noise_variance, process.x, process.y, row_noise=noise
    )
    save_model(path, replace(model, process=noisy))
    read = load_model(path).process
    np.testing.assert_array_equal(read.row_noise, noise)
    np.testing.assert_array_equal(read.predict(process.x).std, noisy.predict(process.x).std)


def test_a_models_sensor_comes_back(saved, wide_sensor):
    sensor, expected = load_model(saved).sensor, wide_sensor
    for name in ("name", "cameras", "exposure", "working_distance_mm"):
        assert getattr(sensor, name) == getattr(expected, name)
    np.testing.assert_allclose(
        sensor.projector.camera_from_projector.to_matrix(),
        expected.projector.camera_from_projector.to_matrix(),
        atol=POSE_TOLERANCE,
    )


def test_the_same_model_gives_the_same_bytes(saved, trained, wide_sensor):
    model = trained(model_named("q_k2"), sensor=wide_sensor)
    again = saved.with_name("again")
    save_model(again, model)
    assert again.read_bytes() == saved.read_bytes()


def test_a_read_model_gives_the_bytes_it_was_read_from(path, trained):
    save_model(path, trained(model_named("q_k6")))
    again = path.with_name("again")
    save_model(again, load_model(path))
    assert again.read_bytes() == path.read_bytes()


# -- what is in it ------------------------------------------------------------------------------


def test_a_models_checksum_is_its_files(path, trained):
    model = trained(model_named("q_k2"))
    save_model(path, model)
    assert model_sha256(model) == hashlib.sha256(path.read_bytes()).hexdigest()
    assert model_sha256(load_model(path)) == model_sha256(model)


def test_a_model_is_an_ordinary_zip_archive_without_pickle(saved):
    with zipfile.ZipFile(saved) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["model.json", "inputs.npy", "targets.npy"]
        x, y = (
            np.load(io.BytesIO(archive.read(name)), allow_pickle=False)
            for name in ("inputs.npy", "targets.npy")
        )
    assert (x.shape, y.shape, x.dtype, y.dtype) == ((60, 2), (60,), np.float64, np.float64)


def test_a_model_says_its_units(saved):
    with zipfile.ZipFile(saved) as archive:
        document = json.loads(archive.read("model.json"))
    assert (document["format"], document["version"]) == ("exposight model", 2)
    assert document["target"] == {"name": "p_norm", "unit": "1"}
    assert document["inputs"] == [
        {"name": "i_avg", "unit": "grey level 0–255"},
        {"name": "z_mm", "unit": "mm"},
    ]


def test_the_archives_comment_is_the_checksum_of_all_before_it(saved):
    data = saved.read_bytes()
    with zipfile.ZipFile(saved) as archive:
        assert archive.comment == data[-DIGEST_LENGTH:]
    assert hashlib.sha256(data[:-DIGEST_LENGTH]).hexdigest().encode() == archive.comment


# -- version 1 ----------------------------------------------------------------------------------

VERSION_1 = Path(__file__).parent / "version-1.exposight-model"
ASKED = {"i_avg": [80, 120, 80], "x_mm": [10, 0, 900], "y_mm": [-20, 0, 0], "z_mm": [5, 0, 0]}
"""What the exposight that wrote the file was asked, and its answers to the bit."""
MEAN = ["0x1.429d5d79484aep+5", "0x1.e0fbe9dd4f710p+5", "0x1.39ea213c9a09bp+5"]
STD = ["0x1.6b44c49f7b2b5p+3", "0x1.4b673bc7ed624p+3", "0x1.593b280bfc7b7p+3"]


def test_a_file_of_version_1_still_predicts_the_same():
    model = load_model(VERSION_1)
    prediction = model.predict(**ASKED, w_deg=[1, 0, 0], p_deg=[-2, 0, 0])
    np.testing.assert_allclose(prediction.mean, list(map(float.fromhex, MEAN)), rtol=1e-12)
    np.testing.assert_allclose(prediction.std, list(map(float.fromhex, STD)), rtol=1e-12)
    assert prediction.inside.tolist() == [True, True, False]
    assert (model.name, model.n_observations, model.sensor.name[:5]) == ("e_k6", 21, "ZEISS")


# -- damaged ------------------------------------------------------------------------------------

SHARES = [0.0, 0.004, 0.02, 0.3, 0.5, 0.55, 0.7, 0.8, 0.95, 0.98, 0.999]
"""Of the file's length: headers, document, arrays, directory, checksum."""


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("flip", [0x01, 0x80])
def test_a_changed_byte_anywhere(saved, share, flip):
    data = bytearray(saved.read_bytes())
    data[int(share * len(data))] ^= flip
    saved.write_bytes(data)
    with pytest.raises(DamagedFileError, match=r"damaged or cut short.*copy it again, or train"):
        load_model(saved)


@pytest.mark.parametrize("length", [10, 39, 40, 100, 4000, -100, -64, -1])
def test_a_file_cut_short(saved, length):
    saved.write_bytes(saved.read_bytes()[:length])
    with pytest.raises(DamagedFileError, match=r"q_k2\.exposight-model: damaged or cut short"):
        load_model(saved)


def test_a_file_with_something_appended(saved):
    saved.write_bytes(saved.read_bytes() + b"\n")
    with pytest.raises(DamagedFileError, match="damaged"):
        load_model(saved)


@pytest.mark.parametrize("share", SHARES)
def test_a_damaged_model_is_still_known_as_one(saved, share):
    data = bytearray(saved.read_bytes())
    data[int(share * len(data))] ^= 0x01
    saved.write_bytes(data)
    assert is_model_file(saved)


# -- newer --------------------------------------------------------------------------------------


def test_a_newer_version(saved):
    rewrite(saved, document=lambda fields: fields.update(version=3))
    with pytest.raises(VersionError, match=r"has version 3 .* reads up to version 2: update expo"):
        load_model(saved)


def test_a_newer_version_with_other_members(saved):
    rewrite(
        saved,
        document=lambda fields: fields.update(version=3, surprise=1),
        members={"inputs.npy": None},
    )
    with pytest.raises(VersionError, match="has version 3"):
        load_model(saved)


# -- something else -----------------------------------------------------------------------------


def test_a_missing_file(path):
    with pytest.raises(MissingFileError, match=r"no model file at .*q_k2\.exposight-model"):
        load_model(path)
    assert not is_model_file(path)


def other_zip():
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")
    return buffer.getvalue()


@pytest.mark.parametrize(
    "content",
    [b"", b"feature,view\n", b"x" * 10_000, other_zip(), npy(np.zeros(30))],
    ids=["empty", "text", "long", "another ZIP", "array"],
)
def test_something_that_is_no_model(path, content):
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"expected a model file .* got something else"):
        load_model(path)
    assert not is_model_file(path)


def test_a_model_is_known_as_one(saved):
    assert is_model_file(saved)


def test_a_folder_that_is_not_there(tmp_path, trained):
    with pytest.raises(FileError, match="does not exist; make it first"):
        save_model(tmp_path / "nowhere" / "m.exposight-model", trained(model_named("q_k1")))


# -- a right checksum over wrong content --------------------------------------------------------


def other_unit(fields):
    fields["inputs"][1]["unit"] = "m"


def other_target(fields):
    fields["target"] = {"name": "x_mm", "unit": "ms"}


def other_input(fields):
    fields["inputs"].pop()


def other_kernel(fields):
    fields["content"]["kernel"] = {"type": "neural_network"}


def other_parameter(fields):
    fields["content"]["kernel"]["factors"][0]["alpha"] = -1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (other_unit, r"'z_mm' is in 'm', expected 'mm'; train the model again"),
        (other_target, r"'x_mm' is in 'ms', expected 'mm'"),
        (other_input, r"a column for each of 1 inputs, got shape \(60, 2\)"),
        (lambda fields: fields.update(kind="oracle"), r"unknown kind of model 'oracle'.*import"),
        (
            other_kernel,
            r"unknown kernel type 'neural_network'.*a newer version of exposight may have written",
        ),
        (other_parameter, r"alpha"),
        (
            lambda fields: fields["content"].pop("noise_variance"),
            r"key 'noise_variance' is missing",
        ),
        (lambda fields: fields["content"].update(noise_variance=0.0), r"key 'noise_variance'"),
        (lambda fields: fields.update(colour="red"), r"key 'colour' is unknown"),
        (lambda fields: fields.update(format="exposight campaign"), r"'format' must be \"exposig"),
        (
            lambda fields: fields.update(version="1"),
            r"'version' must be a whole number from 1 to 2, got \"1\"",
        ),
        (lambda fields: fields.update(sensor="{}"), r"its sensor: key 'format' must be"),
    ],
)
def test_a_document_that_makes_no_sense(saved, change, message):
    rewrite(saved, document=change)
    with pytest.raises(FormatError, match=rf"q_k2\.exposight-model.*{message}"):
        load_model(saved)


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({"model.json": b"{"}, "is not JSON"),
        ({"model.json": None}, "not a model file"),
        ({"targets.npy": None}, "not a model file .*targets is missing"),
        ({"inputs.npy": b"no array"}, "not a readable model file"),
        ({"inputs.npy": npy(np.array([{}, None], dtype=object))}, "Python objects"),
        ({"inputs.npy": npy(np.zeros((60, 3)))}, r"a column for each of 2 inputs, got .*\(60, 3\)"),
        ({"inputs.npy": npy(np.zeros(60))}, r"a column for each of 2 inputs, got shape \(60,\)"),
        ({"targets.npy": npy(np.zeros(59))}, "one target for each of the 60 rows"),
        (
            {"targets.npy": npy(np.full(60, np.nan))},
            "targets.npy holds numbers that are not finite",
        ),
    ],
)
def test_members_that_make_no_sense(saved, members, message):
    rewrite(saved, members=members)
    with pytest.raises(FormatError, match=rf"q_k2\.exposight-model.*{message}"):
        load_model(saved)


def test_other_files_that_end_in_hexadecimal_digits_are_no_models(path):
    path.write_bytes(b"feature,view\nf1," + b"0123456789abcdef" * 4)
    assert not is_model_file(path)
    with pytest.raises(FormatError, match="got something else"):
        load_model(path)
