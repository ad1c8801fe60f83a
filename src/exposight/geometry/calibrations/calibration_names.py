"""What the names in a calibration file say: words, and which device they belong to."""

import re
from collections.abc import Set as AbstractSet
from typing import Literal, NamedTuple, TypeAlias

Role: TypeAlias = Literal["camera", "projector", "first", "second"]

PROJECTOR = frozenset(
    {"proj", "projector", "projectors", "projektor", "prj", "dlp", "beamer", "pro"}
)
CAMERA = frozenset({"cam", "camera", "cameras", "kamera", "frame", "image", "img"})
_PAIRS = (
    ("left", "right"),
    ("l", "r"),
    ("links", "rechts"),
    ("first", "second"),
    ("one", "two"),
    ("master", "slave"),
    ("primary", "secondary"),
    ("1", "2"),
    ("0", "1"),
)
_KIND = frozenset(
    {"k", "m", "kk", "mtx", "matrix", "mat", "intrinsic", "intrinsics", "int", "params"}
    | {"parameters", "data", "calib", "calibration"}
)
"""Words of a camera matrix, which do not tell whose it is."""
DISTORTION = frozenset(
    {"d", "k", "dist", "distortion", "distortions", "coeff", "coeffs", "coef", "coefs"}
    | {"coefficients", "lens"}
)
NOT_OF_IT = frozenset(
    {"new", "newcamera", "opt", "optimal", "rect", "rectified", "rectification", "undist"}
    | {"undistorted", "std", "stddev", "error", "errors", "uncertainty", "covariance", "init"}
)
"""Words of what is derived from a calibration, or tells how good it is."""
_WORDS = (
    "projectors?|projektor|projection|cameras?|kamera|matrix|distortions?|distort|intrinsics?|coefficients|coeffs?|"
    "coefs?|new|optimal|undistorted|rectified|rotation|translation|resolution|screen|frame|image|left|right|width|height|size|proj|"
    "prj|cam|mtx|mat|dist|int|img|res"
)


def words(name: str) -> frozenset[str]:
    """Return the words of a name, in lower case: ``cameraMatrix1`` is camera, matrix and 1.

    ``Kc`` and ``Kp`` are two words each, and so are ``camK`` and ``kleft``.
    """
    found: list[str] = []
    for part in re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+", name):
        lower = part.lower()
        if re.fullmatch("[kdmrt][cplr]", lower) and lower != "tr":
            found += lower
        elif re.fullmatch(rf"[kdmrt]?(?:{_WORDS})+[kdlrxy]?", lower):
            found += re.findall(rf"{_WORDS}|[a-z]", lower)
        else:
            found.append(str(int(lower)) if lower.isdigit() else lower)
    return frozenset(found)


class Told(NamedTuple):
    """What two names tell: which is which, and the words by which they differ."""

    roles: tuple[Role, Role] | None
    apart: tuple[frozenset[str], frozenset[str]]


def told_apart(one: str, other: str) -> Told:
    """Tell by two names which device each is of; no roles where the names do not tell."""
    first, second = words(one), words(other)
    apart = (first - second - _KIND, second - first - _KIND)
    shared = first & second
    return Told(roles=_roles(*apart, shared), apart=apart)


def _roles(
    first: frozenset[str], second: frozenset[str], shared: frozenset[str]
) -> tuple[Role, Role] | None:
    light = [bool(each & PROJECTOR) for each in (first, second)]
    if light == [False, True] or ("p" in second and ("c" in first or first & CAMERA)):
        return "camera", "projector"
    if light == [True, False] or ("p" in first and ("c" in second or second & CAMERA)):
        return "projector", "camera"
    # Numbers alone tell in names of cameras and of camera matrices, not in those of anything.
    known = bool(shared & (_KIND | CAMERA))
    for left, right in _PAIRS:
        if not known and left in "01":
            continue
        if left in first and right in second:
            return "first", "second"
        if right in first and left in second:
            return "second", "first"
    return None


def is_projector(name: str) -> bool:
    """Tell whether a name is of a projector."""
    return bool(words(name) & (PROJECTOR | {"screen", "display"})) or name.lower() in {"kp", "dp"}


def affinity(name: str, own_name: str, own: AbstractSet[str]) -> float:
    """Return how well a name fits a device: the more maps and words are the same, the better.

    Parameters
    ----------
    name : str
        Of any node.
    own_name : str
        Of the device's camera matrix.
    own : set of str
        Words that only the device has (`told_apart`).
    """
    told = words(name)
    return float(len(told & own) - len(own - told)) + 3.0 * shared_maps(name, own_name)


def shared_maps(name: str, other: str) -> int:
    """Return how many maps, from the outermost, two nodes stand in together."""
    count = 0
    for one, two in zip(name.split(".")[:-1], other.split(".")[:-1], strict=False):
        if one != two:
            break
        count += 1
    return count


def group_of(name: str) -> str:
    """Return the map that a node stands in: ``left.K`` is in ``left``."""
    return name.rpartition(".")[0]


_PLACE = frozenset({"pose", "position", "origin", "location"})


def is_directed(name: str) -> bool:
    """Tell whether a name leaves the direction of a transform to the usual convention.

    It does not where it names both devices without from or to (``T_cam_proj``), or a pose, which
    is where a device stands more often than what takes points to it.
    """
    leaf = name.rpartition(".")[2]
    told = words(leaf)
    both = bool(told & PROJECTOR and told & CAMERA) or {"left", "right"} <= told
    return not (both or told & _PLACE) or is_inverse(leaf) is not None


def is_inverse(name: str) -> bool | None:
    """Tell whether a transform's name says that it leads from the second device to the first.

    None where it does not say. ``A_from_B`` takes points of B's frame to A's, ``B_to_A`` and
    ``B2A`` too.
    """
    separate = re.sub(r"(?<=[a-z])2(?=[a-zA-Z])", "_to_", name)
    parts = [part for part in re.split(r"[^A-Za-z0-9]+|(?<=[a-z])(?=[A-Z])", separate) if part]
    lower = [part.lower() for part in parts]
    for join in ("from", "to"):
        if join not in lower:
            continue
        place = lower.index(join)
        sides = [frozenset().union(*map(words, parts[:place])),
                 frozenset().union(*map(words, parts[place + 1 :]))]  # fmt: skip
        target, source = sides if join == "from" else reversed(sides)
        if source & PROJECTOR and not target & PROJECTOR:
            return True
        if target & PROJECTOR and not source & PROJECTOR:
            return False
        for left, right in _PAIRS:
            if left in target and right in source:
                return True
            if left in source and right in target:
                return False
    return None
