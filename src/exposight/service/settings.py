"""Where and how a folder is served, as server processes are told."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from exposight.service.guard import Limits


@dataclass(frozen=True, kw_only=True)
class ServerSettings:
    """Where and how a folder is served.

    Parameters
    ----------
    folder : Path
    host : str
        Address to listen at.
    port : int
        0 takes a free one.
    workers : int
        Server processes.
    token : str or None
    limits : Limits
    """

    folder: Path
    host: str = "127.0.0.1"
    port: int = 8765
    workers: int = 2
    token: str | None = field(default=None, repr=False)
    limits: Limits = field(default_factory=Limits)

    def to_json(self) -> bytes:
        """Return the settings as a worker reads them on its standard input."""
        return json.dumps({**asdict(self), "folder": str(self.folder)}).encode()

    @classmethod
    def from_json(cls, text: bytes) -> ServerSettings:
        """Return settings that `to_json` wrote."""
        raw = json.loads(text)
        return cls(**{**raw, "folder": Path(raw["folder"]), "limits": Limits(**raw["limits"])})
