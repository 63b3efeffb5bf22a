"""Lenses by their surfaces: rays traced through them, and what these say of waves. Lengths are in
millimetres."""
