"""Parses Parquet in a process of its own (`exposight.files.parse_apart`), which may crash on it."""

import io
from typing import Any

import numpy as np
import polars as pl


def parse(data: bytes) -> dict[str, Any]:
    """Return the table in the bytes of a Parquet file as the bytes of an Arrow stream."""
    buffer = io.BytesIO()
    pl.read_parquet(io.BytesIO(data), glob=False).write_ipc_stream(buffer)
    return {"arrow": np.frombuffer(buffer.getvalue(), dtype=np.uint8)}
