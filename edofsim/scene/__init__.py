"""Scenes: procedural builders, spectra, and a recipe turned into plain data for the renderer."""

from .build import build_scene
from .model import BandTexture, Environment, SceneModel, SceneObject, Surface, TriangleMesh

__all__ = [
    "BandTexture",
    "Environment",
    "SceneModel",
    "SceneObject",
    "Surface",
    "TriangleMesh",
    "build_scene",
]
