"""Where a sensor can stand, and what it sees and lights from there."""
