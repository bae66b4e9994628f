"""Drawings of the documents: ``PYTHONPATH=docs/tools python -m drawings FOLDER``."""
