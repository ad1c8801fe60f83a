"""Triangle meshes: their files, their faults, and the holes in them."""
