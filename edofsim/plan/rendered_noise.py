"""What the noise of a view comes to in the ideal image and in the photo, before the view is rendered."""

from __future__ import annotations

import math

from ..capture import capture
from ..capture.noise import LAYERS, photo_noise
from ..capture.photograph import all_in_focus
from ..errors import InputError
from .effect import overall
from .facts import Facts
from .target import sensor_noise

TRUTH_DB = 45.0
"""How far below full scale noise in the ideal image is, where that is asked for."""
SHARE_OF_SENSOR = 0.1
"""Noise of rendering in the photo over the sensor's, where the photo is asked for."""
TYPICAL_DB = 30.0
"""Restored PSNR that the standard error of a score is reported for."""
PLACES = ("photo", "truth")


def noise_in(facts: Facts) -> dict[str, float]:
    """The noise of the view that facts were found in, root mean square over pixels and channels, full scale
    1: `truth` in the ideal image and `photo` in the photo, where the blur averages it: an estimate for
    independent pixels. Empty where the view does not tell its noise."""
    half = facts.view.half_difference
    if half is None:
        return {}
    view = facts.view.with_light(half)
    ideal = view.crop_margin(all_in_focus(view, facts.response)).double() * facts.exposure
    channels = ideal.square().mean((-2, -1)).sqrt().tolist()
    photo = (value * left for value, left in zip(channels, facts.averaging, strict=True))
    return {"truth": overall(tuple(channels)), "photo": overall(tuple(photo))}


def photo_noise_of(facts: Facts) -> float:
    """As `photo` of `noise_in`, of a photo that is taken of the noise."""
    few = {"occlusion": "none", "sub_apertures": 1, "layers": min(LAYERS, facts.layers_of(None))}
    few["field_step_px"] = 0
    coarse = facts.full.changed(few)
    photo = capture(facts.view, facts.camera, coarse, exposure=facts.exposure)
    noise = photo_noise(facts.view, facts.camera, coarse, photo).image
    return 0.0 if noise is None else float(noise.double().square().mean().sqrt())


def view_noise_for(facts: Facts, place: str) -> float | None:
    """The relative noise of a view at which that in a place, `photo` or `truth`, is low enough, to three
    digits; None where there is none. It is taken to fall in each place as it does in the view.

    Raises InputError where the view does not tell its noise, or the sensor has none to compare with.
    """
    if facts.view.noise == 0:
        return None
    sensor = sensor_noise(facts)
    if place == "photo" and not sensor:
        raise InputError("--noise photo: this camera's sensor has no noise; give truth, or a fraction as 1%")
    now = photo_noise_of(facts) if place == "photo" else noise_in(facts).get(place, 0.0)
    if not now:
        raise InputError(f"--noise {place}: a preview does not tell its noise here; give a fraction as 1%")
    wanted = SHARE_OF_SENSOR * sensor if place == "photo" else 10 ** (-TRUTH_DB / 20)
    return float(f"{facts.view.noise * wanted / now:.3g}")


def score_error_db(truth: float, pixels: int, psnr_db: float = TYPICAL_DB) -> float:
    """Standard error of a PSNR in dB, by noise in the ideal image that its score is without: first order, of
    noise that is alike in all channels and independent from pixel to pixel.

    truth: its root mean square, full scale 1.
    """
    return 20 / math.log(10) * truth / (10 ** (-psnr_db / 20) * math.sqrt(pixels))


def noise_in_words(facts: Facts) -> str:
    """What the recipe's samples leave, in a sentence; empty where that is not known."""
    found = {place: value / facts.noise_ratio for place, value in noise_in(facts).items()}
    if not all(found.values()) or not found:
        return ""
    truth, photo = (-20 * math.log10(found[place]) for place in ("truth", "photo"))
    samples = facts.scene.render.samples if facts.recipe else facts.view.metadata.get("samples")
    sensor = sensor_noise(facts)
    share = f" ({found['photo'] / sensor:.2g} of the sensor's noise)" if sensor else ""
    error = score_error_db(found["truth"], facts.view.height * facts.view.width)
    return (
        f"{samples} samples a pixel leave noise of {truth:.1f} dB in the ideal image and {photo:.1f} dB in "
        f"the photo{share}; scores are without it: standard error of a PSNR of {TYPICAL_DB:.0f} dB about "
        f"{error:.2g} dB"
    )
