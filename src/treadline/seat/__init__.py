"""Keeping the seat level."""
