"""A trained camera in one file: the network, the DOE's height map, and a card that says how it came to be.

The file is safetensors: named arrays and text, nothing that could run. Arrays: `network.*`, and for a
learned DOE `mask.height_m` [n, n] (seen from the sensor, row 0 at the pupil's top) with its sampling
`mask.sampling_m`, and `mask.amplitude` [n, n] of one that blocks light.
The card is JSON in the metadata entry `card`, with the keys

    name, format, network (kind, settings), camera (the recipe it was trained for), recipe (the training
    recipe), data (sources, counts, sha256), versions, seed, step, hours (to a tenth; older ones do not have
    them), figures, `weights` where they are not what that training ended with, `chosen`: what else was, on
    which pictures, and `history` where they come from an
    earlier training: these of each one before, the first first; `auxiliary`: the same of the auxiliary
    network (`beside` in older ones)
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import torch
from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from .. import __version__
from ..core.files import write_bytes
from ..core.json_values import Json
from ..core.shipped import RENAMED, comparisons_folder, today
from ..errors import InputError, first_line
from ..optics import PAPER_COLOURS, Camera
from ..optics.fabrication import unscattered_fraction
from ..optics.masks import PhaseMask
from ..optics.masks.height_map import HeightMapMask
from ..optics.materials import material
from ..recipe.base import RecipeModel, in_new_names
from ..recipe.camera import CameraRecipe
from ..recipe.load import Loaded, shipped_folder
from .network import build_network
from .restorer import Restorer

FORMAT = 1
SUFFIX = ".safetensors"
MAX_BYTES = 1 << 30
KEPT = 2
"""Checkpoints in memory that were read last."""
_READ: dict[tuple[object, ...], Checkpoint] = {}
ANY_CAMERA = "universal"
"""The shipped checkpoint for cameras that no network was trained with."""
# what the optics of a photo depend on; noise, exposure and the window of the PSFs may differ
CAMERA_FIELDS = ("lens", "focus", "sensor.pixel_um")


@dataclass(frozen=True)
class Checkpoint:
    """A network in evaluation mode on the CPU, and the DOE it was trained with.

    height: [n, n] in metres, or None where the mask is the camera recipe's own.
    sampling: its pitch in metres.
    amplitude: [n, n], that the mask lets through; None for all.
    card: everything else (see the module).
    """

    network: Restorer
    height: Tensor | None
    sampling: float | None
    card: Json = field(repr=False)
    path: Path | None = None
    amplitude: Tensor | None = None

    @property
    def name(self) -> str:
        name = str(self.card.get("name", "network"))
        return RENAMED.get(name, name)


def shipped_checkpoints() -> dict[str, Path]:
    """Checkpoints that came with the package, each with its camera's mask, by name."""
    found = _checkpoints_in(shipped_folder("train") / "checkpoints")
    return {name: path for name, path in found.items() if name != ANY_CAMERA}


def any_camera_checkpoints() -> dict[str, Path]:
    """That for cameras which no network was trained with, by name; empty where it is missing."""
    found = _checkpoints_in(shipped_folder("train") / "checkpoints")
    return {name: path for name, path in found.items() if name == ANY_CAMERA}


def comparison_checkpoints() -> dict[str, Path]:
    """Those of the systems that ours are compared with, by name; of an installed package, those of the
    release's file that somebody unpacked, see `comparisons_left_out`."""
    return _checkpoints_in(comparisons_folder())


def comparisons_left_out() -> str:
    """Where to get the systems for comparison, a sentence; empty where they are there."""
    if comparison_checkpoints():
        return ""
    file, folder = f"edofsim-comparisons-{__version__}.zip", comparisons_folder()
    return f"the systems for comparison are not installed: unpack {file} of the release into {folder}"


def _checkpoints_in(folder: Path) -> dict[str, Path]:
    return {path.name.removesuffix(SUFFIX): path for path in sorted(folder.glob("*" + SUFFIX))}


def purpose_of(path: Path) -> str:
    """What a checkpoint says of itself, read without its weights; why it cannot be read, where it cannot."""
    try:
        with safe_open(path, framework="pt", device="cpu") as file:
            recipe = json.loads((file.metadata() or {})["card"])["recipe"]
        return str(recipe.get("purpose") or recipe.get("name"))
    except (SafetensorError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return f"cannot be read: {first_line(error)}"


def find_checkpoint(source: str | Path) -> Path:
    """The file of a checkpoint given by path, or of a shipped one by name. Raises InputError."""
    path = Path(source)
    if path.is_file():
        return path
    known = shipped_checkpoints() | any_camera_checkpoints() | comparison_checkpoints()
    if (name := today(str(source))) in known:
        return known[name]
    names, more = ", ".join(known) or "none", comparisons_left_out()
    raise InputError(
        f"{source}: no such checkpoint file, and none shipped of that name; shipped: {names}"
        + (more and f"; {more}")
    )


def save_checkpoint(
    path: Path,
    network: Restorer,
    card: Json,
    *,
    height: Tensor | None = None,
    sampling: float | None = None,
    amplitude: Tensor | None = None,
) -> Path:
    """Write a checkpoint in one piece: after a crash the file is the old one or the new one.

    card: JSON values, keys as in the module's text (`format` and `network` are filled in here).
    height: [n, n] in metres with its sampling in metres.
    amplitude: [n, n], that the mask lets through; None for all.

    Raises EdofsimError where the disk refuses, InputError for values that are not finite.
    """
    arrays = {f"network.{name}": without_denormals(value) for name, value in network.state_dict().items()}
    if height is not None:
        arrays["mask.height_m"] = height
        arrays["mask.sampling_m"] = torch.tensor(sampling, dtype=torch.float64)
    if amplitude is not None:
        arrays["mask.amplitude"] = amplitude
    broken = [name for name, value in arrays.items() if not torch.isfinite(value).all()]
    if broken:
        raise InputError(f"{path}: not saved, since {broken[0]} holds values that are not finite")
    card = {**card, "format": FORMAT, "network": {"kind": network.kind, "settings": network.settings()}}
    save_arrays(path, arrays, {"card": json.dumps(card, sort_keys=True)})
    return path


def load_checkpoint(source: str | Path, camera_recipe: RecipeModel | None = None) -> Checkpoint:
    """The checkpoint in a file, or a shipped one by name; nothing in it is executed.

    camera_recipe: the camera that took the photo.

    Raises InputError for a missing, damaged or truncated file, one that is no checkpoint, and one of another
    camera, naming each field that differs.
    """
    path = find_checkpoint(source)
    arrays, metadata = load_arrays(path, "checkpoint")
    try:
        card = json.loads(metadata["card"])
        kind, settings = card["network"]["kind"], card["network"]["settings"]
        known_format = card["format"] == FORMAT
    except (KeyError, TypeError, ValueError, RecursionError):
        raise InputError(
            f"{path}: no card of an edofsim checkpoint in it; name a file that `edofsim train` wrote"
        ) from None
    if not known_format:
        raise InputError(
            f"{path}: checkpoint format {card['format']!r}, this version reads {FORMAT}; update edofsim"
        )
    network = build_network(kind, settings)
    if camera_recipe is not None and not network.any_camera:
        trained = in_new_names(CameraRecipe, card.get("camera", {}))
        _check_camera(path, trained, camera_recipe.model_dump(mode="json"))
    prefix = "network."
    weights = {
        name.removeprefix(prefix): without_denormals(value)
        for name, value in arrays.items()
        if name.startswith(prefix)
    }
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        raise InputError(
            f"{path}: its weights do not fit its network {kind!r}: {first_line(error)}"
        ) from None
    height, sampling = arrays.get("mask.height_m"), arrays.get("mask.sampling_m")
    if height is not None and (sampling is None or height.ndim != 2 or height.shape[0] != height.shape[1]):
        raise InputError(f"{path}: its height map is not a square array with a sampling; it is damaged")
    if height is not None and network.psfs == "mean" and not network.any_camera:
        network.glare = _glare_in_training(card)
    pitch = None if sampling is None else float(sampling)
    return Checkpoint(network.eval(), height, pitch, card, path, arrays.get("mask.amplitude"))


def read_once(source: str | Path, camera_recipe: RecipeModel | None = None) -> Checkpoint:
    """`load_checkpoint`, and the same checkpoint again while its file and the camera are the same: what its
    network keeps of a camera is there still. For use, not for training: nobody changes it.

    camera_recipe: the camera that took the photo.

    Raises as `load_checkpoint`.
    """
    path = find_checkpoint(source)
    written = path.stat()
    camera = None if camera_recipe is None else camera_recipe.model_dump_json()
    key = (path, written.st_mtime_ns, written.st_size, camera)
    found = _READ.pop(key, None) or load_checkpoint(path, camera_recipe)
    _READ[key] = found
    for oldest in list(_READ)[:-KEPT]:
        del _READ[oldest]
    return found


def _glare_in_training(card: Json) -> tuple[float, ...] | None:
    """What the errors of fabrication spread of the light of the paper's colours in a training; None where its
    card does not say."""
    try:
        error = float(card["recipe"]["doe"]["height_noise_nm"]) * 1e-9
        glass = material(card["camera"]["mask"]["material"])
    except (KeyError, TypeError, ValueError, InputError):
        return None
    return tuple((1 - unscattered_fraction(PAPER_COLOURS, error, glass)).tolist())


def without_denormals(values: Tensor) -> Tensor:
    """The values, with 0 in place of those too small for a normal number: weight decay leaves such weights in
    channels that died, and processors multiply them a hundred times slower.

    values: any shape [...].
    """
    if not values.is_floating_point():
        return values
    return values.masked_fill(values.abs() < torch.finfo(values.dtype).tiny, 0)


def history_of(checkpoint: Checkpoint) -> list[Json]:
    """The trainings that made a checkpoint's weights, the first first, as its successor's card names them."""
    card = checkpoint.card
    said = ("name", "seed", "step", "hours", "data", "versions", "figures", "weights")
    own = {key: card[key] for key in said if key in card}
    return [*card.get("history", []), own]


def trained_camera(checkpoint: Checkpoint) -> CameraRecipe:
    """The camera that the checkpoint was trained for. Raises InputError for a card without one."""
    try:
        return CameraRecipe.model_validate(checkpoint.card["camera"])
    except (KeyError, ValidationError):
        raise InputError(f"{checkpoint.path}: its card names no camera; train the checkpoint again") from None


def camera_with_mask(recipe: CameraRecipe, checkpoint: Checkpoint, base: Path | None = None) -> Camera:
    """The camera with the mask that the checkpoint was trained with in place of its own.

    base: folder that files named in the recipe are relative to.

    Raises InputError as `Camera.from_recipe`.
    """
    camera = Camera.from_recipe(recipe_with_mask(recipe, checkpoint), base)
    return camera.with_height(checkpoint.height).with_amplitude(checkpoint.amplitude)


def recipe_with_mask(recipe: CameraRecipe, checkpoint: Checkpoint) -> CameraRecipe:
    """The recipe of a camera that the height map of a checkpoint, if it has one, can be given to; as it is
    for a network that is for any camera.

    A height map means little without the material and the pitch that it was made for: given to a camera with
    another mask, it would be taken for that mask's material and stretched over the pupil.
    """
    if checkpoint.network.any_camera:
        return recipe
    mask = trained_camera(checkpoint).mask
    if checkpoint.height is not None:
        assert isinstance(mask, PhaseMask) and checkpoint.sampling is not None  # as a training writes them
        mask = HeightMapMask(
            material=mask.material,
            design_wavelength_nm=mask.design_wavelength_nm,
            pitch_um=checkpoint.sampling * 1e6,
        )
    return recipe.model_copy(update={"mask": mask})


def network_of(camera: Loaded[CameraRecipe]) -> Checkpoint | None:
    """The network that was trained together with a camera's mask: that of the checkpoint which the mask's
    height map comes from. None for any other mask. Raises InputError for a damaged checkpoint."""
    mask = camera.recipe.mask
    if not isinstance(mask, HeightMapMask) or mask.file is None or not mask.file.endswith(SUFFIX):
        return None
    path = camera.base / mask.file
    _, metadata = load_arrays(path, "checkpoint")
    return read_once(path, camera.recipe) if "card" in metadata else None


def fits(checkpoint: Checkpoint, camera_recipe: RecipeModel) -> bool:
    """Whether a checkpoint can restore a camera's photos: its lens, focus and pixels are those of the
    training, or the network is for any camera."""
    if checkpoint.network.any_camera:
        return True
    trained = in_new_names(CameraRecipe, checkpoint.card.get("camera", {}))
    return not any(_differences(trained, camera_recipe.model_dump(mode="json")))


def _check_camera(path: Path, trained: Json, given: Json) -> None:
    problems = [
        f"{path}: trained for a camera with {name} = {trained_value!r}, this one has {given_value!r}; "
        "use that camera, or train a checkpoint for this one"
        for name, trained_value, given_value in _differences(trained, given)
    ]
    if problems:
        raise InputError(problems)


def _differences(trained: Json, given: Json) -> Iterator[tuple[str, object, object]]:
    for wanted in CAMERA_FIELDS:
        ours, theirs = (dict(_leaves(_at(recipe, wanted), wanted)) for recipe in (trained, given))
        for name in sorted(ours.keys() | theirs.keys()):
            if ours.get(name) != theirs.get(name):
                yield name, ours.get(name), theirs.get(name)


def _at(recipe: object, name: str) -> object:
    for part in name.split("."):
        recipe = cast(Json, recipe).get(part) if isinstance(recipe, dict) else None
    return recipe


def _leaves(value: object, name: str) -> Iterator[tuple[str, object]]:
    if isinstance(value, dict):
        for key, inner in cast(Json, value).items():
            yield from _leaves(inner, f"{name}.{key}")
    else:
        yield name, value


def save_arrays(path: Path, arrays: Mapping[str, Tensor], metadata: Mapping[str, str]) -> None:
    """Write a safetensors file.

    arrays: of any shape [...], by name.

    Raises what `core.files.whole` raises.
    """
    data = save({name: value.detach().cpu().contiguous() for name, value in arrays.items()}, dict(metadata))
    write_bytes(path, data)


def load_arrays(path: Path, noun: str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Arrays and metadata of a safetensors file. Raises InputError, calling the file a `noun`, where it is
    missing, damaged, too large, or holds values that are not finite."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES >> 30} GiB, which no {noun} is")
        with safe_open(path, framework="pt", device="cpu") as file:
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            metadata = file.metadata() or {}
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; name a {noun}") from None
    except (SafetensorError, OSError, ValueError) as error:
        problem = f"{path}: not a whole {noun} ({first_line(error)}); copy or train it again"
        raise InputError(problem) from None
    for name, value in arrays.items():
        if value.is_floating_point() and not torch.isfinite(value).all():
            raise InputError(f"{path}: {name} holds values that are not finite; this {noun} is damaged")
    return arrays, metadata
