"""edofsim: a physically based 3D scene simulator for extended-depth-of-field cameras."""

__version__ = "0.1.0"
