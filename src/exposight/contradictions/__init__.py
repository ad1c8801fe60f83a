"""Checks that hold two inputs which say the same thing twice against each other.

A check takes arrays and numbers, knows no file and no sensor, and returns what it compared, what it
found and what would explain it (`Contradiction`), or nothing. Who owns the inputs calls the check
and then `settle`, which raises where no right number can come of them.
"""

from exposight.contradictions.contradiction import Contradiction, settle
