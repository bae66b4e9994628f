"""Geometry and statics of stair, tracks, chair and seat."""
