"""Text tables in any dialect: bytes to cells, and headers to known columns with units."""
