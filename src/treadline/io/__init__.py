"""Files: run folders, logs, provenance."""
