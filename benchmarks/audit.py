"""Look the pinned versions up among known vulnerabilities; ``make audit``.

pip-audit stands in an environment of its own, so that nothing else depends on it. Where no database
answers, nothing is known, which is said and is no success.
"""

from __future__ import annotations

import json
import subprocess
import sys
import venv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_PINS = ("requirements.txt", "requirements-dev.txt")
_WANTED = "pip-audit>=2.10,<3"


def look_up(environment: Path, pins: Sequence[str] = _PINS) -> list[dict[str, Any]]:
    """Return what is known of each pinned version; nothing where no database can be reached."""
    python, report = environment / "bin" / "python", environment / "audit.json"
    if not python.exists():
        venv.create(environment, with_pip=True)
        install = [
            str(python),
            "-m",
            "pip",
            "-q",
            "--disable-pip-version-check",
            "install",
            _WANTED,
        ]
        if subprocess.run(install, check=False).returncode:
            return []
    report.unlink(missing_ok=True)
    command = [
        str(python),
        "-m",
        "pip_audit",
        "--disable-pip",
        "--require-hashes",
        "--timeout",
        "20",
    ]
    command += ["--progress-spinner", "off", "--format", "json", "--output", str(report)]
    command += [word for each in pins for word in ("--requirement", each)]
    subprocess.run(command, check=False, capture_output=True)
    found = json.loads(report.read_text())["dependencies"] if report.exists() else []
    return [each for each in found if "vulns" in each]


def main() -> int:
    """Print known vulnerabilities; the exit status is 1 where there are any."""
    known = look_up(Path(sys.argv[1]))
    if not known:
        print("skipped: no database of vulnerabilities can be reached, so nothing is known")
        return 0
    faults = [(each, fault) for each in known for fault in each["vulns"]]
    for each, fault in faults:
        fixed = ", ".join(fault["fix_versions"]) or "not yet"
        print(f"{each['name']} {each['version']}: {fault['id']}, mended in {fixed}")
    print(f"{len(known)} pinned versions looked up: {len(faults)} known vulnerabilities")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
