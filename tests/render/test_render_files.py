"""Views as files: the spectral layout, read back by OpenEXR alone and by ourselves; the cache and what
damages it."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
import shutil
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace

import numpy as np
import OpenEXR
import pytest
import torch

from edofsim.errors import DiskFullError, InputError
from edofsim.recipe import SceneRecipe
from edofsim.render import Task, cache, cached, render, view_key
from edofsim.render.batch import rendered
from edofsim.render.exr import channel_name, read_view, write_view
from edofsim.render.view import View


def made_view(scale=1.0, seed=0):
    """A view of 6 x 4 pixels with a margin of 1, three bands, one edge, something hidden, sky at the top."""
    rng = np.random.default_rng(seed)
    pixels = np.arange(48)
    fragments = []
    for pixel in pixels:
        depth = 0.0 if pixel < 8 else 0.5
        if pixel % 8 == 4:
            fragments += [(pixel, 0.25, 2.0, False), (pixel, 0.75, depth, False), (pixel, 0.25, depth, True)]
        else:
            fragments.append((pixel, 1.0, depth, False))
    pixel, coverage, inverse_depth, hidden = zip(*fragments, strict=True)
    radiance = rng.uniform(0.1, 1, (3, len(pixel))) * coverage * scale
    return View(
        height=4,
        width=6,
        margin=1,
        pixel=torch.tensor(pixel),
        coverage=torch.tensor(coverage),
        inverse_depth=torch.tensor(inverse_depth),
        radiance=torch.tensor(radiance, dtype=torch.float32),
        hidden=torch.tensor(hidden),
        wavelengths=torch.tensor([420e-9, 570e-9, 720e-9], dtype=torch.float64),
        pixel_angle=1.626e-4,
        noise=0.03,
        metadata={"hidden": "behind 16.7 % of the pixels", "samples": 4, "run": {"seconds": 1.5}},
    )


def test_noise_comes_back_with_its_variance(tmp_path):
    """Two bits of mantissa: each value to an eighth, whatever its level, and so little of the power. A file
    without noise reads as before."""
    rng = np.random.default_rng(4)
    view = made_view()
    for level in (1e-6, 1e-2, 1e3):
        noise = torch.tensor(level * rng.normal(size=(3, view.pixel.numel())), dtype=torch.float32)
        stored = write_view(tmp_path / "noise.exr", replace(view, half_difference=noise).fragments())
        found = read_view(tmp_path / "noise.exr")
        assert np.array_equal(found.half_difference, stored().half_difference)
        off = found.half_difference / noise.numpy() - 1
        assert np.abs(off).max() < 0.126 and np.abs(off).max() > 0.01
        assert float((found.half_difference**2).mean() / (noise**2).mean()) == pytest.approx(1, abs=0.06)
        assert np.array_equal(found.radiance, read_plain(tmp_path, view).radiance)
    assert read_plain(tmp_path, view).half_difference is None


def read_plain(folder, view):
    write_view(folder / "plain.exr", view.fragments())
    return read_view(folder / "plain.exr")


def recipe(**more):
    """A card before a wall: the smallest scene with an edge."""
    data = {
        "name": "card",
        "bands": {"count": 3},
        "frame": {"width_px": 12, "height_px": 8, "margin_px": 2, "pixel_angle_mrad": 4.0},
        "render": {"samples": 8, "max_depth": 2},
        "lights": [{"kind": "environment"}],
        "objects": [
            {"kind": "wall", "depth_m": 2.0},
            {"kind": "panel", "depth_m": 0.8, "width_mm": 20, "height_mm": 300},
        ],
    }
    return SceneRecipe.model_validate({**data, **more})


@pytest.mark.parametrize("scale", [1.0, 3e6, 1e-7], ids=["usual", "very bright", "very dark"])
def test_view_survives_its_file(tmp_path, scale):
    """Everything comes back: depth and coverage exactly, radiance to half float's 11 bits, in its range."""
    view = made_view(scale)
    write_view(tmp_path / "view.exr", view.fragments(), {"name": "card"})
    back = View.of(read_view(tmp_path / "view.exr"))
    for name in ("height", "width", "margin", "pixel_angle", "noise"):
        assert getattr(back, name) == getattr(view, name)
    for name in ("pixel", "coverage", "hidden", "wavelengths"):
        assert torch.equal(getattr(back, name), getattr(view, name)), name
    assert torch.allclose(back.inverse_depth, view.inverse_depth, rtol=1e-6)
    assert torch.allclose(back.radiance, view.radiance, rtol=2**-11, atol=0)
    assert back.metadata == {"hidden": "behind 16.7 % of the pixels", "samples": 4}


@pytest.mark.parametrize("scale", [1.0, 3e6, 1e-7], ids=["usual", "very bright", "very dark"])
def test_a_view_that_is_written_is_the_one_that_will_be_read(tmp_path, scale):
    """To the bit, so that what follows a rendering does not differ from what follows the cache."""
    written = View.of(write_view(tmp_path / "view.exr", made_view(scale).fragments(), {"name": "card"})())
    back = View.of(read_view(tmp_path / "view.exr"))
    for field in fields(View):
        one, other = getattr(written, field.name), getattr(back, field.name)
        if isinstance(one, torch.Tensor):
            assert one.dtype == other.dtype and torch.equal(one, other), field.name
        else:
            assert one == other, field.name


def test_fragments_are_the_view_s_in_arrays():
    """Both ways, and what is made of them is the same to the bit."""
    view = made_view()
    fragments = view.fragments()
    back = View.of(fragments)
    for field in fields(View):
        one, other = getattr(view, field.name), getattr(back, field.name)
        assert torch.equal(one, other) if isinstance(one, torch.Tensor) else one == other, field.name
    assert np.array_equal(fragments.all_in_focus(), view.all_in_focus().numpy())
    assert np.array_equal(fragments.mean_inverse_depth(), view.mean_inverse_depth().numpy())
    assert (fragments.padded_shape, fragments.bands) == (view.padded_shape, view.bands)


def test_bytes_follow_from_the_view(tmp_path):
    write_view(tmp_path / "one.exr", made_view().fragments(), {"b": 1, "a": 2})
    write_view(tmp_path / "two.exr", made_view().fragments(), {"a": 2, "b": 1})
    assert (tmp_path / "one.exr").read_bytes() == (tmp_path / "two.exr").read_bytes()


def test_layout_of_fichet_et_al(tmp_path):
    """Channel names, attributes and types of the spectral layout; Z as OpenEXR defines it; overscan as
    windows."""
    view = made_view(3e6)
    write_view(tmp_path / "view.exr", view.fragments(), {"name": "card"})
    image = OpenEXR.File(str(tmp_path / "view.exr"), separate_channels=True).parts[0]
    header = image.header
    assert header["spectralLayoutVersion"] == "1.0" and header["emissiveUnits"] == "W.m^-2.sr^-1"
    assert json.loads(header["recipe"]) == {"name": "card"}
    spectral = [name for name in image.channels if name.startswith("S0.")]
    assert spectral == ["S0.420,000000nm", "S0.570,000000nm", "S0.720,000000nm"]
    assert image.channels["S0.420,000000nm"].pixels.dtype == np.float16
    stored = np.stack([image.channels[name].pixels.astype(float) for name in spectral])
    assert np.isfinite(stored).all()
    assert stored * 2.0 ** header["EV"] == pytest.approx(view.all_in_focus().numpy(), rel=2e-3)
    depth = image.channels["Z"].pixels
    assert depth.dtype == np.float32 and np.isinf(depth[0, 0]) and depth[3, 0] == 2.0
    # the edge: harmonic mean of 1/4 at 0.5 m and 3/4 at 2 m
    assert depth[3, 4] == pytest.approx(1 / (0.25 * 2 + 0.75 * 0.5))
    assert tuple(header["dataWindow"][0]) == (-1, -1) and tuple(header["displayWindow"][1]) == (5, 3)


def test_channel_names():
    assert channel_name(420e-9) == "S0.420,000000nm"
    assert channel_name(550.5e-9) == "S0.550,500000nm"


def test_colour_science_reads_the_image(tmp_path):
    pytest.importorskip("OpenImageIO")
    import colour

    view = made_view()
    write_view(tmp_path / "view.exr", view.fragments())
    components = colour.read_spectral_image_Fichet2021(str(tmp_path / "view.exr"))
    wavelengths, values = components["S0"]
    assert wavelengths == pytest.approx([420, 570, 720])
    assert np.moveaxis(values, -1, 0) == pytest.approx(view.all_in_focus().numpy(), rel=2e-3)


def test_key_is_what_decides_the_pixels(tmp_path):
    """Order and the reader's words do not matter; any number, a named file's content, and the noise do."""
    one = recipe()
    shuffled = SceneRecipe.model_validate(
        dict(reversed(one.model_dump(mode="json", exclude_none=True).items()))
    )
    key = view_key(one, tmp_path)
    assert key == view_key(shuffled, tmp_path)
    assert key == view_key(one.model_copy(update={"purpose": "another", "camera": "paper-clear"}), tmp_path)
    assert key != view_key(one.model_copy(update={"seed": 1}), tmp_path)
    assert key != view_key(recipe(render={"samples": 9, "max_depth": 2}), tmp_path)
    assert key != view_key(one, tmp_path, noise=0.01)
    textured = [
        {
            "kind": "wall",
            "depth_m": 2.0,
            "surface": {"kind": "matt", "texture": {"kind": "file", "path": "a.png"}},
        }
    ]
    named = recipe(objects=textured)
    (tmp_path / "a.png").write_bytes(b"first")
    before = view_key(named, tmp_path)
    (tmp_path / "a.png").write_bytes(b"second")
    assert view_key(named, tmp_path) != before


NAMING = {
    "m.obj": ("mtllib m.mtl\nv 0 0 0\n", "m.mtl", "newmtl a\nKd 1 0 0\n"),
    "n.obj": ("mtllib n.mtl\n", "t.png", "another picture"),
    "m.ply": ("ply\ncomment TextureFile t.png\nend_header\n", "t.png", "another picture"),
    "m.gltf": ('{"images": [{"uri": "t.png"}]}', "t.png", "another picture"),
    "s.xml": (
        '<scene><path value="parts"/><string value="inner.png"/></scene>',
        "parts/inner.png",
        "another",
    ),
    "i.xml": ('<scene><path value="parts"/><include filename="i.xml"/></scene>', "parts/deep.png", "another"),
}


@pytest.mark.parametrize("name", NAMING)
def test_views_are_made_anew_where_a_file_that_a_file_names_changes(tmp_path, name):
    text, changed, content = NAMING[name]
    (tmp_path / "parts").mkdir()
    for each in ("t.png", "parts/inner.png", "parts/deep.png"):
        (tmp_path / each).write_text("a picture")
    (tmp_path / "n.mtl").write_text("newmtl a\nmap_Kd t.png\n")
    (tmp_path / "m.mtl").write_text("newmtl a\n")
    (tmp_path / "parts" / "i.xml").write_text('<scene><string value="deep.png"/></scene>')
    (tmp_path / name).write_text(text)
    kind = {"kind": "mitsuba"} if name.endswith("xml") else None
    item = {"kind": "mesh", "path": name, "size_mm": 9, "depth_m": 1.0}
    data = {"name": "own", "source": {**kind, "path": name}} if kind else {"name": "own", "objects": [item]}
    named = SceneRecipe.model_validate({**data, "lights": [{"kind": "sky"}]})
    before = view_key(named, tmp_path)
    assert view_key(named, tmp_path) == before
    (tmp_path / changed).write_text(content)
    assert view_key(named, tmp_path) != before


def test_rendered_once(mi, tmp_path):
    """The second time a view comes from the cache, and is the same."""
    messages = []
    first = render(
        recipe(), tmp_path, cache=tmp_path, progress=lambda fraction, text: messages.append((fraction, text))
    )
    assert (
        messages
        and messages[-1][0] == 1.0
        and all(a[0] <= b[0] + 1e-9 for a, b in zip(messages, messages[1:], strict=False))
    )
    messages.clear()
    second = render(recipe(), tmp_path, cache=tmp_path, progress=lambda *said: messages.append(said))
    assert not messages
    assert torch.equal(first.radiance, second.radiance) and first.metadata == second.metadata
    assert torch.equal(cached(recipe(), tmp_path, cache=tmp_path).radiance, first.radiance)
    assert cached(recipe(seed=5), tmp_path, cache=tmp_path) is None
    (entry,) = cache.ls(tmp_path)
    assert entry.scene == "card" and entry.record["samples"] == 8 and entry.record["noise"] == first.noise
    assert cache.verify(tmp_path) == cache.Verified(1, ())
    assert not list(tmp_path.glob("*.partial")) and not list(tmp_path.glob("*.tmp"))


def damaged(kind, path):
    content = path.read_bytes()
    if kind == "truncated":
        path.write_bytes(content[: len(content) // 2])
    elif kind == "bit flipped":
        middle = len(content) // 2
        path.write_bytes(content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :])
    elif kind == "zero length":
        path.write_bytes(b"")
    elif kind == "foreign":
        path.write_bytes(b"not an image at all")
    elif kind == "no checksum":
        path.with_suffix(".json").unlink()
    elif kind == "checksum damaged":
        path.with_suffix(".json").write_text('{"sha256": ')


@pytest.mark.parametrize(
    "kind", ["truncated", "bit flipped", "zero length", "foreign", "no checksum", "checksum damaged"]
)
def test_damaged_entry_is_set_aside_and_rendered_again(mi, tmp_path, kind, caplog):
    first = render(recipe(), tmp_path, cache=tmp_path)
    (path,) = tmp_path.glob("*.exr")
    good = path.read_bytes()
    damaged(kind, path)
    bad = path.read_bytes()
    again = render(recipe(), tmp_path, cache=tmp_path)
    assert "is damaged" in caplog.text and "rendered again" in caplog.text
    assert torch.equal(again.radiance, first.radiance)
    assert path.read_bytes() == good
    assert (tmp_path / f"{path.name}.damaged-1").read_bytes() == bad


def test_verify_sets_aside_and_numbers(mi, tmp_path):
    render(recipe(), tmp_path, cache=tmp_path)
    (path,) = tmp_path.glob("*.exr")
    for number in (1, 2):
        keep = path.read_bytes(), path.with_suffix(".json").read_bytes()
        damaged("bit flipped", path)
        checked = cache.verify(tmp_path)
        assert checked.good == 0 and [p.name for p in checked.damaged] == [f"{path.name}.damaged-{number}"]
        path.write_bytes(keep[0])
        path.with_suffix(".json").write_bytes(keep[1])
    assert cache.verify(tmp_path).good == 1


def test_prune_by_age_and_leftovers(mi, tmp_path):
    """Entries that were not used for so long go; so does what interrupted or damaged work left."""
    render(recipe(), tmp_path, cache=tmp_path)
    render(recipe(seed=1), tmp_path, cache=tmp_path)
    old, new = sorted(tmp_path.glob("*.exr"))
    os.utime(old, (0, 0))
    shutil.copy(new, f"{new}.damaged-1")
    (tmp_path / "notes.txt").write_text("mine")
    removed = cache.prune(tmp_path, older_than_days=30)
    assert [e.path for e in cache.ls(tmp_path)] == [new] and removed.bytes > 0
    assert (tmp_path / "notes.txt").exists() and not list(tmp_path.glob("*.damaged-*"))
    cache.prune(tmp_path)
    assert cache.ls(tmp_path) == [] and (tmp_path / "notes.txt").exists()


@pytest.mark.parametrize("count", [3, pytest.param(8, marks=pytest.mark.slow)])
def test_processes_that_want_one_view(tmp_path, count):
    """All succeed, one renders, one entry is there."""
    work = rendered, Task(recipe(), tmp_path), None, tmp_path
    with ProcessPoolExecutor(count, multiprocessing.get_context("spawn")) as workers:
        outcomes = [each.result(300) for each in [workers.submit(*work) for _ in range(count)]]
    assert sum(outcome.fresh for outcome in outcomes) == 1
    assert len(cache.ls(tmp_path)) == 1 and cache.verify(tmp_path) == cache.Verified(1, ())
    assert not list(tmp_path.glob("*.damaged-*"))


def test_folder_that_cannot_be_written(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    with pytest.raises(InputError, match="cannot be written.*--cache"):
        render(recipe(), tmp_path, cache=blocked)


def test_full_disk_is_one_message(tmp_path, monkeypatch):
    """A write that meets a full disk names the entry and leaves no half of it."""

    def half(path, view, recipe):
        path.write_bytes(b"half a view")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(cache, "write_view", half)
    place = cache.Place(tmp_path, "card", "0" * 64)
    with pytest.raises(DiskFullError, match="card.*exr: cannot be written, the disk is full.*--cache"):
        cache.store(place, made_view().fragments(), {}, {})
    assert not list(tmp_path.iterdir())


def test_default_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("EDOFSIM_CACHE", str(tmp_path))
    assert cache.default_folder() == tmp_path
    monkeypatch.delenv("EDOFSIM_CACHE")
    assert cache.default_folder().name in ("render_cache", "views")
