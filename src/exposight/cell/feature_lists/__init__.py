"""A part's list of features in files: tables, DMIS, QIF; found in a mesh and matched."""
