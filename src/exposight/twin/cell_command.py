"""The projector and the robot of a served cell, as commands: run as a script, it imports nothing.

    python cell_command.py FILE show PATTERN
    python cell_command.py FILE move VIEW MATRIX

FILE holds the port at which the cell listens on loopback. What the cell answers is printed.
"""

import json
import socket
import sys
from pathlib import Path

_WAIT_S = 110.0


def main(arguments: list[str]) -> int:
    """Send a request to the cell, and print what it answers."""
    try:
        port = int(Path(arguments[0]).read_text(encoding="ascii"))
        with socket.create_connection(("127.0.0.1", port), timeout=_WAIT_S) as link:
            link.sendall(json.dumps(arguments[1:]).encode() + b"\n")
            answer = json.loads(link.makefile("rb").readline() or b"{}")
    except (OSError, ValueError) as error:
        sys.stderr.write(f"the served cell does not answer: {error}\n")
        return 1
    sys.stderr.write(answer.get("error", "" if "said" in answer else "no answer"))
    sys.stdout.write(answer.get("said", ""))
    return 0 if "said" in answer else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
