"""Files that are whole or absent: durable writing, locks, documents and their faults."""
