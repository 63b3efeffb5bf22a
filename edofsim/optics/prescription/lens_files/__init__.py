"""Lens files of other programs: Zemax, CODE V, OSLO and optiland, as surfaces of ours."""
