"""Calibrations as users bring them: OpenCV's YAML and XML.

OpenCV's own parser reads all of them, also files that start with a ``%YAML:`` line, at which
ordinary YAML readers stop. No two programs name their nodes alike, so the caller names them;
`CalibrationKeys` holds such a naming and `KNOWN_KEYS` those met so far.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from exposight.contradictions import settle
from exposight.contradictions.rigs import baseline
from exposight.errors import FormatError, MissingFileError, PoseError, SensorError
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.poses import RigidTransform


@dataclass(frozen=True, kw_only=True)
class CalibrationKeys:
    """The names of the nodes that hold a camera and a projector in an OpenCV file.

    The four size entries are either one node of a number each, or, where two of them name the same
    node, a matrix that holds height and width.
    """

    camera_matrix: str
    camera_distortion: str
    projector_matrix: str
    projector_distortion: str
    rotation: str
    translation_mm: str
    camera_size: tuple[str, str]
    """Nodes of the image's width and height, or the same node twice for a (height, width) pair."""
    projector_size: tuple[str, str] | None = None
    """The same for the projector; None where the file does not say."""


KNOWN_KEYS: Mapping[str, CalibrationKeys] = {
    "slstudio": CalibrationKeys(
        camera_matrix="Kc",
        camera_distortion="kc",
        projector_matrix="Kp",
        projector_distortion="kp",
        rotation="Rp",
        translation_mm="Tp",
        camera_size=("frameWidth", "frameHeight"),
        projector_size=("screenResX", "screenResY"),
    ),
    "procam-calibration": CalibrationKeys(
        camera_matrix="cam_int",
        camera_distortion="cam_dist",
        projector_matrix="proj_int",
        projector_distortion="proj_dist",
        rotation="roration",  # so spelled by the program that writes it
        translation_mm="translation",
        camera_size=("img_shape", "img_shape"),
    ),
}
"""Namings met in the wild: SLStudio, and procam-calibration."""


@dataclass(frozen=True, kw_only=True)
class ProjectorCamera:
    """A calibrated camera and projector.

    Calibration files hold ``projector_from_camera``, the motion that takes a point from the
    camera's frame to the projector's (``Rp`` and ``Tp`` of SLStudio): its translation is *not*
    the projector's position. Sensors hold the projector's pose in the camera's frame, which is the
    inverse, ``camera_from_projector``. Here is where one becomes the other.

    Parameters
    ----------
    camera, projector : PinholeCamera
        Intrinsic parameters; the projector is a camera with its light running the other way.
    projector_from_camera : RigidTransform
        Extrinsic parameters, mm.

    Raises
    ------
    ContradictionError
        If both cannot stand so close or so far apart.
    """

    camera: PinholeCamera
    projector: PinholeCamera
    projector_from_camera: RigidTransform

    def __post_init__(self) -> None:
        apart_mm = float(np.linalg.norm(self.projector_from_camera.translation_mm))
        settle([baseline(apart_mm, "camera and projector")])

    @property
    def camera_from_projector(self) -> RigidTransform:
        """The projector's pose in the camera's frame, as sensors hold it."""
        return self.projector_from_camera.inverse()

    def to_slstudio(self) -> str:
        """Write an OpenCV YAML file that names its nodes as SLStudio does."""
        keys = KNOWN_KEYS["slstudio"]
        file = cv2.FileStorage(
            ".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
        )
        for matrix, distortion, lens in (
            (keys.camera_matrix, keys.camera_distortion, self.camera),
            (keys.projector_matrix, keys.projector_distortion, self.projector),
        ):
            file.write(matrix, lens.matrix)
            file.write(distortion, np.array(lens.distortion or (0.0,) * 5)[None])
        file.write(keys.rotation, self.projector_from_camera.rotation)
        file.write(keys.translation_mm, self.projector_from_camera.translation_mm[:, None])
        for sizes, lens in (
            (keys.camera_size, self.camera),
            (keys.projector_size or (), self.projector),
        ):
            for key, size in zip(sizes, (lens.width, lens.height), strict=True):
                file.write(key, size)
        return str(file.releaseAndGetString())


@dataclass(frozen=True, kw_only=True)
class OpenCVFile:
    """The nodes of an OpenCV YAML or XML file: matrices as float64 arrays, numbers, text."""

    path: Path
    nodes: Mapping[str, NDArray[np.float64] | float | str]

    def matrix(self, key: str, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
        """Return a node as an array.

        Parameters
        ----------
        key : str
            The node's name.
        shape : tuple of int, optional
            The shape it must have.

        Raises
        ------
        FormatError
            If the node is missing, is not numbers, or has another shape.
        """
        node = self._node(key)
        if isinstance(node, str):
            msg = f"{self.path}: node '{key}' must be numbers, got the text {node!r}"
            raise FormatError(msg)
        array = np.asarray(node, dtype=np.float64)
        if shape is not None and array.shape != shape:
            msg = f"{self.path}: node '{key}' must have shape {shape}, got {array.shape}"
            raise FormatError(msg)
        return array

    def whole_numbers(self, key: str, count: int) -> list[int]:
        """Return a node that is so many integers; errors as for `matrix`."""
        numbers = self.matrix(key).reshape(-1).tolist()
        if len(numbers) != count:
            expected = "one number" if count == 1 else f"{count} numbers"
            msg = f"{self.path}: node '{key}' must be {expected}, got {len(numbers)}"
            raise FormatError(msg)
        for number in numbers:
            if not number.is_integer():
                msg = f"{self.path}: node '{key}' must be whole, got {number}"
                raise FormatError(msg)
        return [int(number) for number in numbers]

    def _node(self, key: str) -> NDArray[np.float64] | float | str:
        if key not in self.nodes:
            msg = (
                f"{self.path}: no node '{key}'; the file has {', '.join(self.nodes) or 'none'}. "
                "Name the nodes as the file does, or calibrate again"
            )
            raise FormatError(msg)
        return self.nodes[key]


def read_opencv_file(path: str | Path) -> OpenCVFile:
    """Read an OpenCV YAML or XML file, with or without a ``%YAML:`` line.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    OpenCVFile
        Matrices are float64; nested maps become ``outer.inner``.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If OpenCV cannot parse it or it holds no node.
    """
    path = Path(path)
    if not path.is_file():
        msg = f"{path}: no such calibration file"
        raise MissingFileError(msg)
    text = path.read_text(encoding="utf-8", errors="replace").lstrip("\ufeff").lstrip()
    header_lines = 0
    if not text.startswith(("<", "%YAML", "{")):
        text = _opencv_yaml(text)
        header_lines = _HEADER.count("\n")
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        nodes = dict(_walk(root, "")) if root.isMap() else {}
    except (cv2.error, SystemError, UnicodeDecodeError) as error:
        reason = _reason(str(error.__cause__ or error), header_lines)
        msg = (
            f"{path}: not an OpenCV YAML or XML file ({reason}); expected a calibration as OpenCV "
            "or ROS camera_info writes it"
        )
        raise FormatError(msg) from error
    if not nodes:
        msg = f"{path}: expected an OpenCV YAML or XML file with matrices, found no node in it"
        raise FormatError(msg)
    return OpenCVFile(path=path, nodes=nodes)


_HEADER = "%YAML:1.0\n---\n"


def _reason(error: str, header_lines: int) -> str:
    """Return the message of OpenCV's parser, ``… in function '(6): Missing ':''``, with its line.

    `header_lines` are those that were put before the file's first line.
    """
    message = error.strip().rpartition("in function '")[2].removesuffix("'")
    line = re.match(r"\((\d+)\): ", message)
    if line is None:
        return message
    return f"line {max(int(line[1]) - header_lines, 1)}: {message[line.end() :]}"


def _opencv_yaml(text: str) -> str:
    """Turn plain YAML, as ROS and others write it, into what OpenCV's parser takes.

    The parser wants its own header, one document, where a message dump is a stream of them, and
    the items of a list further in than the list's key, where most writers put them beneath it.
    """
    first = text.removeprefix("---").lstrip().partition("\n---")[0]
    return _HEADER + re.sub(r"^( *)- ", r"\1  - ", first, flags=re.MULTILINE) + "\n"


def _walk(node: cv2.FileNode, prefix: str) -> list[tuple[str, NDArray[np.float64] | float | str]]:
    nodes: list[tuple[str, NDArray[np.float64] | float | str]] = []
    for key in node.keys():  # noqa: SIM118  (an OpenCV node, not a mapping)
        child = node.getNode(key)
        name = f"{prefix}{key}"
        if child.isMap():
            matrix = child.mat() if _is_matrix(child) else None
            if matrix is not None:
                nodes.append((name, np.asarray(matrix, dtype=np.float64)))
            else:
                nodes.extend(_walk(child, f"{name}."))
        elif child.isSeq():
            items = [child.at(i) for i in range(child.size())]
            if all(item.isReal() or item.isInt() for item in items):
                nodes.append((name, np.array([item.real() for item in items])))
            else:
                nodes.append((name, "a list with more in it than numbers"))
        elif child.isString():
            nodes.append((name, child.string()))
        elif child.isReal() or child.isInt():
            nodes.append((name, float(child.real())))
    return nodes


def _is_matrix(node: cv2.FileNode) -> bool:
    keys = set(node.keys())
    # OpenCV 5 gives arrays of other than two dimensions a list of sizes.
    return {"dt", "data"} <= keys and ({"rows", "cols"} <= keys or "sizes" in keys)


def read_projector_camera(
    path: str | Path,
    keys: CalibrationKeys | None = None,
    *,
    projector_size: tuple[int, int] | None = None,
) -> ProjectorCamera:
    """Read a camera, a projector and the transform between them from one OpenCV file.

    Parameters
    ----------
    path : path
        OpenCV YAML or XML.
    keys : CalibrationKeys, optional
        How the file names its nodes; by default the one of `KNOWN_KEYS` whose camera or projector
        matrix the file holds.
    projector_size : (int, int), px, optional
        The projector's width and height, needed where the file does not hold them.

    Raises
    ------
    MissingFileError, FormatError
        If the file or a node is missing or malformed.
    PoseError
        If the rotation is none.
    ContradictionError
        If both cannot stand so close or so far apart: the translation may be in metres.
    """
    file = read_opencv_file(path)
    keys = keys or _recognise(file)
    if projector_size is None:
        if keys.projector_size is None:
            msg = f"{file.path}: the projector's size is not in the file; give its width and height"
            raise FormatError(msg)
        projector_size = read_size(file, keys.projector_size)
    camera_size = read_size(file, keys.camera_size)
    rotation = file.matrix(keys.rotation, (3, 3))
    translation_mm = file.matrix(keys.translation_mm)
    try:
        projector_from_camera = RigidTransform(rotation=rotation, translation_mm=translation_mm)
    except PoseError as error:
        msg = f"{file.path}: {error}"
        raise PoseError(msg) from error
    apart_mm = float(np.linalg.norm(translation_mm))
    settle([baseline(apart_mm, f"camera and projector in {file.path}")])
    return ProjectorCamera(
        camera=read_camera(file, keys.camera_matrix, keys.camera_distortion, camera_size),
        projector=read_camera(
            file, keys.projector_matrix, keys.projector_distortion, projector_size
        ),
        projector_from_camera=projector_from_camera,
    )


def read_camera(
    file: OpenCVFile, matrix: str, distortion: str, size: tuple[int, int]
) -> PinholeCamera:
    """Return the camera of two nodes, and of a size in px (width, height).

    Raises
    ------
    FormatError
        If a node is missing or malformed.
    """
    numbers = file.matrix(matrix)
    if numbers.size != 9:  # a ROS message lists them row by row
        msg = f"{file.path}: node '{matrix}' must be 3×3 or 9 numbers, got shape {numbers.shape}"
        raise FormatError(msg)
    coefficients = file.matrix(distortion)
    try:
        return PinholeCamera.from_matrix(
            numbers.reshape(3, 3), width=size[0], height=size[1], distortion=coefficients
        )
    except SensorError as error:
        msg = f"{file.path}: {error}"
        raise FormatError(msg) from error


def _recognise(file: OpenCVFile) -> CalibrationKeys:
    for keys in KNOWN_KEYS.values():
        if {keys.camera_matrix, keys.projector_matrix} & set(file.nodes):
            return keys
    known = "; ".join(
        f"{name}: {keys.camera_matrix}, {keys.projector_matrix}, …"
        for name, keys in KNOWN_KEYS.items()
    )
    msg = (
        f"{file.path}: expected a camera and a projector named as by a known program ({known}), "
        f"got {', '.join(file.nodes)}; say which node is which with CalibrationKeys"
    )
    raise FormatError(msg)


def read_size(file: OpenCVFile, keys: tuple[str, str]) -> tuple[int, int]:
    """Return width and height from their nodes, or (height, width) from one; errors as `matrix`."""
    if keys[0] == keys[1]:
        height, width = file.whole_numbers(keys[0], 2)
        return width, height
    (width,), (height,) = (file.whole_numbers(key, 1) for key in keys)
    return width, height
