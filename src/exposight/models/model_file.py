"""A trained model as one self-contained file: an ordinary ZIP archive, without pickle.

``model.json`` holds everything but arrays, which are files ``NAME.npy``; the archive's comment is
the SHA-256 of all bytes before it, so that any damage shows. Which arrays there are is the kind's
matter (`Predictor.to_document`). Documented in ``docs/formats.md``.
"""

import hashlib
import io
import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from exposight.cell import ActiveSensor
from exposight.errors import DamagedFileError, FormatError, InputError, NumericalError
from exposight.files import (
    DocumentFormat,
    check_header,
    parse_json,
    parsing,
    read_array,
    read_bytes,
    read_members,
    sha256_of,
    write_durably,
)
from exposight.models.predictor import Predictor, Provenance, predictor_kind
from exposight.quantities import quantity

MODEL_SUFFIX = ".exposight-model"
"""Ending of a model file's name."""

_Kind = TypeVar("_Kind", bound=Predictor)

_CONTENT_OF_VERSION_1 = ("source", "p_norm_min", "kernel", "noise_variance", "fit")
_MANIFEST, _ARRAY = "model.json", ".npy"
_NAME = r"[^./\\\x00-\x1f\x7f][^/\\\x00-\x1f\x7f]{0,199}"
_EPOCH = (1980, 1, 1, 0, 0, 0)  # ZIP's earliest date: the same model gives the same bytes
_DIGEST_LENGTH = 64
_TAIL_LENGTH = 22 + _DIGEST_LENGTH
_HEAD_LENGTH = 40  # ZIP's header of the first member, 30 bytes, and that member's name


@dataclass(frozen=True, kw_only=True)
class _Variable:
    name: str
    unit: str


@dataclass(frozen=True, kw_only=True)
class _Manifest:
    kind: str
    """Which kind of predictor: `Predictor.kind`."""
    name: str
    title: str
    target: _Variable
    inputs: tuple[_Variable, ...]
    provenance: Provenance
    sensor: str | None
    """The sensor's own JSON document, as text."""
    content: dict[str, Any]
    """What this kind keeps: `Predictor.to_document`."""

    def __post_init__(self) -> None:
        if not re.fullmatch(_NAME, self.name):
            msg = f"a model's name names its file, got {self.name!r}; use letters, digits, _ and -"
            raise InputError(msg)
        columns = [each.name for each in self.inputs]
        if len(set(columns)) < len(columns) or not all((self.target.name, *columns)):
            msg = f"a model reads columns by their names, each once, got {', '.join(columns)}"
            raise InputError(msg)


_FORMAT = DocumentFormat("exposight model", 2, _Manifest)


def save_model(path: str | Path, model: Predictor) -> None:
    """Write a trained model to one file, durably; the same model gives the same bytes.

    Parameters
    ----------
    path : path
        Should end in `MODEL_SUFFIX`.
    model : Predictor
        Of any registered kind.

    Raises
    ------
    FileError
        If it cannot be written; a file that was there stays whole.
    """
    write_durably(Path(path), _file_of(model))


def model_sha256(model: Predictor) -> str:
    """Return the SHA-256 of the file that `save_model` writes of a model."""
    return sha256_of(_file_of(model))


def _file_of(model: Predictor) -> bytes:
    content, arrays = model.to_document()
    manifest = _Manifest(
        kind=model.kind,
        name=model.name,
        title=model.title,
        target=_variable(model.target),
        inputs=tuple(map(_variable, model.inputs)),
        provenance=model.provenance,
        sensor=model.sensor.to_json() if model.sensor else None,
        content=content,
    )
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(_member(_MANIFEST), _FORMAT.to_json(manifest).encode())
        for name, array in arrays.items():
            data = io.BytesIO()
            np.save(data, array, allow_pickle=False)
            archive.writestr(_member(f"{name}{_ARRAY}"), data.getvalue())
        archive.comment = b"0" * _DIGEST_LENGTH
    unsealed = buffer.getvalue()[:-_DIGEST_LENGTH]
    digest = hashlib.sha256(unsealed).hexdigest().encode()
    return unsealed + digest


@overload
def load_model(path: str | Path) -> Predictor: ...
@overload
def load_model(path: str | Path, kind: type[_Kind]) -> _Kind: ...
def load_model(path: str | Path, kind: type[Predictor] = Predictor) -> Predictor:
    """Read a trained model and make it ready to predict.

    Parameters
    ----------
    path : path
        A file that `save_model` wrote.
    kind : type, optional
        Of predictor that is wanted, such as `GaussianProcessModel`; any by default.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it is something else.
    DamagedFileError
        If a single byte has changed since it was written.
    VersionError
        If a newer version of exposight wrote it.
    """
    path = Path(path)
    data = read_bytes(path, "model file")
    if not _is_marked(data[:_HEAD_LENGTH], data[-_TAIL_LENGTH:]):
        msg = (
            f"{path}: expected a model file (a ZIP archive that `train` wrote), got something else"
        )
        raise FormatError(msg)
    if hashlib.sha256(data[:-_DIGEST_LENGTH]).hexdigest().encode() != data[-_DIGEST_LENGTH:]:
        msg = (
            f"{path}: damaged or cut short: its checksum does not match its content; "
            "copy it again, or train the model again"
        )
        raise DamagedFileError(msg)
    document, arrays = _unpacked(data, path)
    common = {
        "name": document.name,
        "title": document.title,
        "target": document.target.name,
        "inputs": tuple(variable.name for variable in document.inputs),
        "provenance": document.provenance,
        "sensor": ActiveSensor.from_json(document.sensor, source=f"{path}: its sensor")
        if document.sensor
        else None,
    }
    try:
        model = predictor_kind(document.kind).from_document(common, document.content, arrays)
    except KeyError as error:
        msg = f"{path}: not a model file ({error.args[0]} is missing)"
        raise FormatError(msg) from error
    except (InputError, FormatError, NumericalError) as error:
        msg = f"{path}: {error}"
        raise FormatError(msg) from error
    except Exception:  # a kind may be anybody's, and raise what it likes
        with parsing(path, "model file"):
            raise
    if not isinstance(model, kind):
        msg = f"{path}: expected a model of kind {kind.kind!r}, got {model.kind!r}"
        raise FormatError(msg)
    return model


def _unpacked(data: bytes, path: Path) -> tuple[_Manifest, dict[str, NDArray[Any]]]:
    """Return what a model file holds, checked as far as it is the same for all kinds."""
    members = read_members(data, path, "model file", most_bytes=len(data))  # it packs nothing
    if _MANIFEST not in members:
        msg = f"{path}: not a model file ({_MANIFEST} is missing)"
        raise FormatError(msg)
    with parsing(path, "model file"):
        raw = parse_json(members.pop(_MANIFEST).decode(), str(path))
    check_header(raw, format_name=_FORMAT.name, newest=_FORMAT.version, source=str(path))
    arrays = {
        name.removesuffix(_ARRAY): read_array(member, f"{path}: {name}", "model file")
        for name, member in members.items()
    }
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            msg = f"{path}: not a model file ({name}{_ARRAY} holds numbers that are not finite)"
            raise FormatError(msg)
    document = _FORMAT.from_dict(_from_version_1(raw) if raw["version"] == 1 else raw, str(path))
    _check_units(document, str(path))
    return document, arrays


def is_model_file(path: str | Path) -> bool:
    """Return whether a file looks like a model, without verifying it."""
    path = Path(path)
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(_HEAD_LENGTH)
        file.seek(max(0, file.seek(0, io.SEEK_END) - _TAIL_LENGTH))
        return _is_marked(head, file.read())


def _is_marked(head: bytes, tail: bytes) -> bool:
    """Recognise a model by its beginning or its end, so that a damaged one is still one."""
    local_header = b"PK\x03\x04"
    if len(head) < _HEAD_LENGTH:  # cut off where no other file ends
        return head.startswith(local_header)
    begins = head.startswith(local_header) and head.endswith(_MANIFEST.encode())
    # Other files end in hexadecimal digits too, but not behind the end of a ZIP archive.
    ends = re.fullmatch(rb"PK\x05\x06.{16}\x40\x00[0-9a-f]{64}", tail, re.DOTALL)
    return begins or ends is not None


def _member(name: str) -> zipfile.ZipInfo:
    return zipfile.ZipInfo(name, date_time=_EPOCH)


def _variable(name: str) -> _Variable:
    return _Variable(name=name, unit=quantity(name).unit)


def _from_version_1(raw: dict[str, Any]) -> dict[str, Any]:
    """Return the document of version 1, which knew Gaussian processes only, as one of today."""
    head = {key: value for key, value in raw.items() if key not in _CONTENT_OF_VERSION_1}
    content = {key: raw[key] for key in _CONTENT_OF_VERSION_1 if key in raw}
    return {**head, "kind": "gaussian-process", "content": content}


def _check_units(document: _Manifest, source: str) -> None:
    for variable in (document.target, *document.inputs):
        unit = quantity(variable.name).unit
        if variable.unit != unit:
            msg = (
                f"{source}: variable '{variable.name}' is in '{variable.unit}', expected "
                f"'{unit}'; train the model again"
            )
            raise FormatError(msg)
