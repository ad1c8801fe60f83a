"""Point clouds in files: each format, and what a file is by its content."""
