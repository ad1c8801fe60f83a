"""Run the command line as ``python -m exposight``."""

import sys

from exposight.cli import main

if __name__ == "__main__":  # worker processes import this module too
    sys.exit(main())
