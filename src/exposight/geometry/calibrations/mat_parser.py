"""Parses MATLAB files in a process of its own (`exposight.files.parse_apart`): scipy may crash."""

import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.io import loadmat

_DEEPEST = 20
_MOST = 2000


def parse(data: bytes) -> dict[str, Any]:
    """Return a .mat file's arrays by number, and as JSON which variables hold them."""
    arrays: dict[str, Any] = {}

    def described(value: Any, depth: int) -> Any:
        if depth > _DEEPEST or len(arrays) > _MOST:
            msg = "it is nested too deeply, or holds too many values"
            raise ValueError(msg)
        if isinstance(value, Mapping):
            return {str(key): described(each, depth + 1) for key, each in value.items()}
        array = np.asarray(value)
        if array.dtype.kind not in "biufUS":
            array = np.array(f"a value of the type {array.dtype}")
        arrays[f"array{len(arrays)}"] = array
        return len(arrays) - 1

    content = loadmat(io.BytesIO(data), simplify_cells=True)
    tree = described({k: v for k, v in content.items() if not k.startswith("__")}, 0)
    return {"tree": np.array(json.dumps(tree)), **arrays}
