"""Recipes: the TOML files that a person writes, validated."""

from .camera import CameraRecipe
from .load import Loaded, load_camera, load_scene, shipped, shipped_folder
from .scene import SceneRecipe

__all__ = ["CameraRecipe", "Loaded", "SceneRecipe", "load_camera", "load_scene", "shipped", "shipped_folder"]
