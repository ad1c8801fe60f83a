"""Run the command line as ``python -m exposight``."""

from exposight.cli import main

if __name__ == "__main__":  # the demonstration's worker processes import this module too
    main()
