"""What cannot be photographed, found before any time is spent."""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import InputError
from ..optics import Camera
from ..recipe import SceneRecipe
from ..render.view import View
from .fidelity import RENDERED, Fidelity, pupil_is_free
from .occlusion import OCCLUSIONS

PIXEL_ANGLE_SLACK = 1e-3
"""Relative difference of pixel angles that is taken as rounding: half a pixel over a frame of 512."""
CHIEF_RAY_SLACK = 0.1
"""Pixels between the chief rays of a view and of a camera that are taken as rounding."""


def check_fidelity(fidelity: Fidelity) -> None:
    """Raise InputError for ways to composite that there are not, and for what is for rendering alone."""
    rendered = [name for name in RENDERED if getattr(fidelity, name) != getattr(Fidelity, name)]
    if rendered:
        raise InputError(
            f"{', '.join(rendered)} of the fidelity: for rendering alone, and a view is rendered already; "
            "leave it out, or give `fidelity.of_photo()`"
        )
    if fidelity.occlusion not in OCCLUSIONS:
        raise InputError(
            f"occlusion {fidelity.occlusion!r} is not known: choose one of {', '.join(OCCLUSIONS)}"
        )


def check_fits(fidelity: Fidelity, camera: Camera, recipe: SceneRecipe | None = None) -> None:
    """Raise InputError for a fidelity made for another camera or scene, which would ignore some of it."""
    window = camera.recipe.psf.window_px
    problems = []
    if (fidelity.window_px or 0) > window:
        problems.append(f"window_px = {fidelity.window_px}, and the camera's PSFs have {window} pixels")
    if fidelity.pupil_sampling_um is not None and not pupil_is_free(camera):
        problems.append("pupil_sampling_um is given, and the camera's recipe or made mask says it already")
    if fidelity.sub_apertures > 1 and fidelity.occlusion != "hidden":
        problems.append(f"sub_apertures = {fidelity.sub_apertures} belong to occlusion = 'hidden' alone")
    if recipe is not None:
        most = {"samples": recipe.render.samples, "bounces": recipe.render.max_depth}
        for name, there in most.items():
            asked = getattr(fidelity, name)
            if asked is not None and (recipe.source is not None or asked > there):
                holds = "its light is read, not rendered" if recipe.source is not None else f"it has {there}"
                problems.append(f"{name} = {asked} is more than the scene {recipe.name} gives: {holds}")
    if problems:
        raise InputError([f"the fidelity does not fit: {problem}" for problem in problems])


def check_view(view: View) -> None:
    """Raise InputError for a view with values that are not light or not depth, naming the pixels."""
    problems = []
    check_pixels(view)
    depth = view.inverse_depth.detach()
    if _sound(depth, view.coverage.detach(), view.radiance.detach()):
        return
    bad = torch.isnan(depth)
    if bool(bad.any()):
        problems.append(f"the view's depth is NaN {_where(view, bad)}: render it again")
    bad = (depth < 0) | torch.isinf(depth)
    if bool(bad.any()):
        problems.append(
            f"the view has depths that are negative or zero {_where(view, bad)}: only what lies in "
            "front of the lens can be photographed"
        )
    bad = ~torch.isfinite(view.radiance.detach()).all(0)
    if bool(bad.any()):
        problems.append(f"the view's radiance is NaN or infinite {_where(view, bad)}: render it again")
    coverage = view.coverage.detach()
    bad = ~((coverage >= 0) & (coverage <= 1 + 1e-4))
    if bool(bad.any()):
        problems.append(f"the view's coverage is not between 0 and 1 {_where(view, bad)}: render it again")
    if problems:
        raise InputError(problems)


def check_pixels(view: View) -> None:
    """Raise InputError for fragments beyond the frame with its margin, or not sorted by pixel."""
    rows, columns = view.padded_shape
    if not view.pixel.numel():
        return
    first, last = (int(end) for end in view.pixel.aminmax())
    if first < 0 or last >= rows * columns:
        raise InputError(
            f"the view's pixels go from {first} to {last}, and a frame of {columns} x {rows} with its margin "
            f"has 0 to {rows * columns - 1}: they count in the frame with its margin, row by row"
        )
    if bool((view.pixel[1:] < view.pixel[:-1]).any()):
        raise InputError("the view's fragments are not sorted by pixel")


def _sound(depth: Tensor, coverage: Tensor, radiance: Tensor) -> bool:
    """Whether nothing can be wrong, found by few passes; comparisons with NaN are false."""
    if not depth.numel():
        return False
    near, far = depth.aminmax()
    least, most = coverage.aminmax()
    bounds = bool(near >= 0) and bool(far < float("inf")) and bool(least >= 0) and bool(most <= 1 + 1e-4)
    return bounds and bool(torch.isfinite(radiance.sum()))


def distortion_of(view: View, camera: Camera) -> str:
    """Where the distortion of a camera's lens is in a view: `rendered` along its chief rays, `as in the view`
    where that is taken to have it already, as pictures have, `none` where the lens has none.

    Raises InputError for a view along the chief rays of another lens.
    """
    rays = view.metadata.get("chief_rays")
    if not rays:
        return "as in the view" if camera.lens.chief_rays(view.pixel_angle * view.width / 2) else "none"
    own = camera.lens.chief_rays(rays[-1][0]) or ((0.0, 1.0, 0.0),) * len(rays)
    apart = max(
        place * abs(ratio - other) for (place, ratio, _), (_, other, _) in zip(rays, own, strict=False)
    )
    if len(own) != len(rays) or apart > CHIEF_RAY_SLACK * view.pixel_angle:
        raise InputError(
            f"the view was rendered along the chief rays of another lens than that of {camera.recipe.name},"
            f" up to {apart / view.pixel_angle:.2g} pixels off: render it for this camera"
        )
    return "rendered"


def check_pixel_angle(view: View, pixel_angle: float) -> None:
    """Raise InputError for a view whose pixels see another angle than the camera's."""
    if abs(view.pixel_angle / pixel_angle - 1) > PIXEL_ANGLE_SLACK:
        raise InputError(
            f"a pixel of the view sees {view.pixel_angle * 1e3:.6g} mrad and one of the camera's "
            f"{pixel_angle * 1e3:.6g} mrad: render with frame.pixel_angle_mrad = {pixel_angle * 1e3:.7g}, "
            "choose another camera, or resample the view (--resample, `edofsim.view(..., resample=True)`); "
            "a picture "
            "takes the camera's: `View.from_image(..., pixel_angle=camera.pixel_angle)`"
        )


def check_window(view: View, window: int) -> None:
    """Raise InputError for PSFs that are wider than the image with its margin."""
    rows, columns = view.padded_shape
    if window > min(rows, columns):
        raise InputError(
            f"the PSFs' window of {window} pixels is wider than the image of {columns} x {rows} pixels "
            "with its margin: render a larger frame or margin, or make psf.window_px smaller"
        )


def _where(view: View, bad: Tensor) -> str:
    """Names the first few pixels, counted in the frame (row, column from its top left corner)."""
    columns = view.padded_shape[1]
    pixels = torch.unique(view.pixel[bad]).tolist()
    named = ", ".join(f"({p // columns - view.margin}, {p % columns - view.margin})" for p in pixels[:5])
    more = f" and {len(pixels) - 5} more" if len(pixels) > 5 else ""
    return f"at (row, column) {named}{more}"


NEAR_SHARE = 1e-3
"""Of the pixels of a picture that may lie within the focal length of a lens, as a few wrong depths do."""


def check_near(view: View, camera: Camera) -> None:
    """Raise InputError for depths within the lens's focal length, as those in another unit are."""
    seen = ~view.hidden
    focal = float(camera.lens.focal_length(float(view.wavelengths.mean())))
    near = view.inverse_depth[seen] > 1 / focal
    share = float(near.double().mean()) if near.numel() else 0.0
    if share >= NEAR_SHARE:
        nearest = 1 / float(view.inverse_depth[seen].max())
        raise InputError(
            f"the depth map puts {share:.1%} of the picture nearer than the focal length of the lens "
            f"({focal * 1e3:.3g} mm), the nearest at {nearest:.3g} m: is its unit another? In "
            "[source.depth], "
            'unit = 0.001 is for millimetres, and holds = "relative_inverse_depth" with near_m and far_m for '
            "what a network estimates"
        )
