"""Speed and accuracy, measured: each benchmark prints a table and, last, one JSON object."""
