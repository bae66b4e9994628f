"""Figures, tables and pages, drawn from run folders alone."""
