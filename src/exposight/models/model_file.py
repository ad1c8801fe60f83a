"""A trained model as one self-contained file: an ordinary ZIP archive, without pickle.

``model.json`` holds everything but the numbers trained on, which are ``inputs.npy`` and
``targets.npy``; the archive's comment is the SHA-256 of all bytes before it, so that any damage
shows. Factors are not stored: they follow from the data, and are computed again when it is read.
Documented in ``docs/formats.md``.
"""

from __future__ import annotations

import hashlib
import io
import re
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from exposight.cell import ActiveSensor
from exposight.errors import DamagedFileError, FormatError, InputError, MissingFileError
from exposight.files.documents import StrictDocument, check_header, parse_json, validate
from exposight.files.durable import write_durably
from exposight.gp import GaussianProcess, kernel_from_dict
from exposight.models.specification import UNITS, ModelSpecification, Target
from exposight.models.trained_model import FitSummary, Provenance, TrainedModel

if TYPE_CHECKING:
    from numpy.typing import NDArray

MODEL_SUFFIX = ".exposight-model"
"""Ending of a model file's name."""

_FORMAT = "exposight model"
_VERSION = 1
_MANIFEST, _INPUTS, _TARGETS = "model.json", "inputs.npy", "targets.npy"
_EPOCH = (1980, 1, 1, 0, 0, 0)  # ZIP's earliest date: the same model gives the same bytes
_DIGEST_LENGTH = 64
_HEAD_LENGTH = 40  # ZIP's header of the first member, 30 bytes, and that member's name


class _VariableDocument(StrictDocument):
    name: str
    unit: str


class _TargetDocument(_VariableDocument):
    name: Target


class _FitDocument(StrictDocument):
    log_marginal_likelihood: float
    converged: bool
    evaluations: int
    starts: int
    parameters_at_bound: tuple[str, ...]


class _ProvenanceDocument(StrictDocument):
    observations: str
    observations_sha256: str | None
    emulated: bool
    seed: int
    exposight_version: str


class _ModelDocument(StrictDocument):
    format: str
    version: int
    name: str
    title: str
    source: str
    target: _TargetDocument
    inputs: tuple[_VariableDocument, ...]
    p_norm_min: float | None
    kernel: dict[str, Any]
    noise_variance: float = Field(gt=0)
    fit: _FitDocument
    provenance: _ProvenanceDocument
    sensor: str | None
    """The sensor's own JSON document, as text."""


def save_model(path: str | Path, model: TrainedModel) -> None:
    """Write a trained model to one file, durably.

    The same model gives the same bytes.

    Parameters
    ----------
    path : path
        Should end in `MODEL_SUFFIX`.
    model : TrainedModel
        What to write.

    Raises
    ------
    FileError
        If it cannot be written; a file that was there stays whole.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        members = {
            _MANIFEST: _document(model).model_dump_json(indent=2).encode(),
            _INPUTS: _npy(model.process.x),
            _TARGETS: _npy(model.process.y),
        }
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(name, date_time=_EPOCH), data)
        archive.comment = b"0" * _DIGEST_LENGTH
    content = buffer.getvalue()[:-_DIGEST_LENGTH]
    digest = hashlib.sha256(content).hexdigest().encode()
    write_durably(Path(path), content + digest)


def load_model(path: str | Path) -> TrainedModel:
    """Read a trained model and make it ready to predict.

    Parameters
    ----------
    path : path
        A file that `save_model` wrote.

    Returns
    -------
    TrainedModel

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
    if not path.is_file():
        msg = f"{path}: no such model file"
        raise MissingFileError(msg)
    data = path.read_bytes()
    if not _is_marked(data[:_HEAD_LENGTH], data[-_DIGEST_LENGTH:]):
        msg = (
            f"{path}: expected a model file (a ZIP archive that `train` wrote), got something else"
        )
        raise FormatError(msg)
    _check_digest(path, data)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            manifest = archive.read(_MANIFEST).decode()
            raw = parse_json(manifest, str(path))
            check_header(raw, format_name=_FORMAT, newest=_VERSION, source=str(path))
            x = _read_npy(archive.read(_INPUTS))
            y = _read_npy(archive.read(_TARGETS))
    except (zipfile.BadZipFile, KeyError, ValueError) as error:
        msg = f"{path}: not a model file ({error})"
        raise FormatError(msg) from error
    document = validate(_ModelDocument, manifest, str(path))
    try:
        return _model(document, x, y, source=str(path))
    except InputError as error:
        msg = f"{path}: {error}"
        raise FormatError(msg) from error


def is_model_file(path: str | Path) -> bool:
    """Tell whether a file looks like a model, without verifying it."""
    path = Path(path)
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(_HEAD_LENGTH)
        file.seek(max(0, file.seek(0, io.SEEK_END) - _DIGEST_LENGTH))
        return _is_marked(head, file.read())


def _is_marked(head: bytes, tail: bytes) -> bool:
    """Tell a model by its beginning or its end, so that one damage does not make it a stranger."""
    local_header = b"PK\x03\x04"
    if len(head) < _HEAD_LENGTH:  # cut off where no other file ends
        return head.startswith(local_header)
    begins = head.startswith(local_header) and head.endswith(_MANIFEST.encode())
    return begins or re.fullmatch(rb"[0-9a-f]{64}", tail) is not None


def _check_digest(path: Path, data: bytes) -> None:
    content, digest = data[:-_DIGEST_LENGTH], data[-_DIGEST_LENGTH:]
    if hashlib.sha256(content).hexdigest().encode() != digest:
        msg = (
            f"{path}: damaged or cut short: its checksum does not match its content; "
            "copy it again, or train the model again"
        )
        raise DamagedFileError(msg)


def _document(model: TrainedModel) -> _ModelDocument:
    specification, summary, provenance = model.specification, model.summary, model.provenance
    return _ModelDocument(
        format=_FORMAT,
        version=_VERSION,
        name=specification.name,
        title=specification.title,
        source=specification.source,
        target=_TargetDocument(name=specification.target, unit=UNITS[specification.target]),
        inputs=tuple(
            _VariableDocument(name=name, unit=UNITS[name]) for name in specification.inputs
        ),
        p_norm_min=specification.p_norm_min,
        kernel=model.process.kernel.to_dict(),
        noise_variance=model.process.noise_variance,
        fit=_FitDocument(
            log_marginal_likelihood=summary.log_marginal_likelihood,
            converged=summary.converged,
            evaluations=summary.evaluations,
            starts=summary.starts,
            parameters_at_bound=summary.parameters_at_bound,
        ),
        provenance=_ProvenanceDocument(
            observations=provenance.observations,
            observations_sha256=provenance.observations_sha256,
            emulated=provenance.emulated,
            seed=provenance.seed,
            exposight_version=provenance.exposight_version,
        ),
        sensor=model.sensor.to_json() if model.sensor else None,
    )


def _model(
    document: _ModelDocument, x: NDArray[np.float64], y: NDArray[np.float64], *, source: str
) -> TrainedModel:
    kernel = kernel_from_dict(document.kernel)
    _check_variables(document, source)
    if x.ndim != 2 or x.shape[1] != len(document.inputs):
        msg = (
            f"{source}: {_INPUTS} must have a column for each of {len(document.inputs)} inputs, "
            f"got shape {x.shape}"
        )
        raise FormatError(msg)
    return TrainedModel(
        specification=ModelSpecification(
            name=document.name,
            title=document.title,
            target=document.target.name,
            inputs=tuple(variable.name for variable in document.inputs),
            kernel=kernel,
            p_norm_min=document.p_norm_min,
            source=document.source,
        ),
        process=GaussianProcess.condition(kernel, document.noise_variance, x, y),
        summary=FitSummary(**document.fit.model_dump()),
        provenance=Provenance(**document.provenance.model_dump()),
        sensor=ActiveSensor.from_json(document.sensor, source=f"{source}: its sensor")
        if document.sensor
        else None,
    )


def _check_variables(document: _ModelDocument, source: str) -> None:
    for variable in (document.target, *document.inputs):
        unit = UNITS.get(variable.name)
        if unit is None:
            msg = f"{source}: no variable '{variable.name}'; expected one of {', '.join(UNITS)}"
            raise FormatError(msg)
        if variable.unit != unit:
            msg = (
                f"{source}: variable '{variable.name}' is in '{variable.unit}', expected "
                f"'{unit}'; train the model again"
            )
            raise FormatError(msg)


def _npy(array: NDArray[np.float64]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def _read_npy(data: bytes) -> NDArray[np.float64]:
    array = np.load(io.BytesIO(data), allow_pickle=False)
    return np.asarray(array, dtype=np.float64)
