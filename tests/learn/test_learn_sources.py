"""Training pictures: read with every problem named, split by picture, drawn by the seed alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from edofsim.errors import InputError
from edofsim.learn.sources import central_patches, draw_patches, packaged_images, read_folder, split


def _pictures(folder: Path, sizes: list[tuple[int, int]]) -> None:
    for index, (rows, columns) in enumerate(sizes):
        array = np.full((rows, columns, 3), index, np.uint8)
        Image.fromarray(array).save(folder / f"{index}.png")


def test_every_unusable_picture_is_named(tmp_path: Path) -> None:
    _pictures(tmp_path, [(40, 40), (39, 60)])
    (tmp_path / "torn.jpg").write_bytes(b"\xff\xd8 not a picture")
    with pytest.raises(InputError) as caught:
        read_folder(tmp_path, 40)
    assert len(caught.value.problems) == 2
    assert any(
        "1.png" in problem and "60 x 39" in problem and "40" in problem for problem in caught.value.problems
    )
    assert any("torn.jpg" in problem for problem in caught.value.problems)


def test_missing_and_empty_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        read_folder(tmp_path / "none", 8)
    (tmp_path / "notes.txt").write_text("no picture")
    with pytest.raises(InputError, match="holds no pictures"):
        read_folder(tmp_path, 8)


def test_the_hash_names_the_pictures(tmp_path: Path) -> None:
    _pictures(tmp_path, [(8, 8), (8, 8)])
    first = read_folder(tmp_path, 8).sha256
    assert read_folder(tmp_path, 8).sha256 == first
    Image.fromarray(np.full((8, 8, 3), 9, np.uint8)).save(tmp_path / "1.png")
    assert read_folder(tmp_path, 8).sha256 != first


def test_validation_pictures_are_never_trained_on() -> None:
    images = packaged_images(100)
    training, held_back = split(images, 0.3, seed=5)
    assert set(training.names) | set(held_back.names) == set(images.names)
    assert not set(training.names) & set(held_back.names)
    assert split(images, 0.3, seed=5)[1].names == held_back.names


def test_patches_follow_the_seed_and_come_from_the_pictures(tmp_path: Path) -> None:
    _pictures(tmp_path, [(16, 20), (16, 20), (64, 80)])
    images = read_folder(tmp_path, 8)
    seeds = (torch.Generator().manual_seed(seed) for seed in (1, 1, 2))
    draws, means, _ = zip(*(draw_patches(images, 300, 8, (3, 2), seed) for seed in seeds), strict=True)
    assert torch.equal(means[0], draws[0].mean((2, 3)))  # pictures without detail
    assert draws[0].shape == (300, 3, 13, 13)
    assert torch.equal(draws[0], draws[1]) and not torch.equal(draws[0], draws[2])
    # flat pictures: each patch has its picture's number; the third has 16/18 of the area
    numbers = (draws[0][:, 0, 0, 0] * 255).round().long()
    share = float((numbers == 2).double().mean())
    assert abs(share - 16 / 18) < 4 * (16 / 18 * 2 / 18 / 300) ** 0.5


def test_pictures_are_continued_by_their_mirror_image() -> None:
    images = packaged_images(190)
    patches, means, _ = central_patches(images, 3, 190, (40, 39))  # one of them is only 191 pixels high
    assert patches.shape == (3, 3, 269, 269) and means.shape == (3, 3)
