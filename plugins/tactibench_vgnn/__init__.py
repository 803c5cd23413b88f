"""Voronoi graph network: pins, their neighbours and the room they have tell the contacts."""
