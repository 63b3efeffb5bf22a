"""Recipes and checkpoints that come with the package, by name."""

from __future__ import annotations

import logging
from importlib.util import find_spec
from pathlib import Path

from platformdirs import user_data_dir

LOG = logging.getLogger(__name__)
RENAMED = {"any-bank": "universal", "told-dcnn": "depth-dcnn"}
"""Earlier names of networks and their trainings."""
IN_CHECKOUT = {"plugin": "tests/example_package"}
"""Where shipped folders are that have another name there."""


def today(name: str) -> str:
    """The name of a shipped network or training, given that or an earlier one, which a line says."""
    if name in RENAMED:
        LOG.warning("%s is called %s now", name, RENAMED[name])
    return RENAMED.get(name, name)


def shipped_folder(name: str) -> Path:
    """`scenes`, `train` or `plugin`: in the checkout, or inside an installed package."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "shipped" / name
    return installed if installed.is_dir() else package.parent / IN_CHECKOUT.get(name, name)


def comparisons_folder() -> Path:
    """Checkpoints of systems for comparison: in the checkout, or where the user of an installed package
    unpacks those of a release (`make release`)."""
    folder = shipped_folder("train") / "checkpoints" / "comparisons"
    return folder if folder.is_dir() else Path(user_data_dir("edofsim", appauthor=False)) / "comparisons"


def installed(package: str) -> Path:
    """The folder of an installed package, which is not imported for it."""
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(f"the package {package} is not installed", name=package)
    return Path(spec.origin).parent


def shipped(folder: Path, suffix: str = ".toml") -> dict[str, Path]:
    """Files of a shipped folder by name, without their ending; recipes unless another is given."""
    return {path.name.removesuffix(suffix): path for path in sorted(folder.glob("*" + suffix))}


def typed_as(path: Path) -> str:
    """What a recipe is called on a command line: its name where it is shipped, else its path from the folder
    of now, if it is inside."""
    scenes = shipped_folder("scenes")
    if path.resolve().parent in (scenes, scenes / "cameras", shipped_folder("train")):
        return path.stem
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)
