"""Images of fragments in tiles at depth nodes, of those pairs of both where anything lies."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from edofsim.plan.fragments import Fragments, Tiled, at_nodes
from edofsim.plan.passing import passing
from edofsim.plan.tiles import Tiles, _chances

TILES, SIDE = 3, 4
SOME = Tiles(SIDE, SIDE, SIDE, ((0, 0),) * TILES, torch.ones(TILES), torch.ones(TILES, SIDE, SIDE))
NODES = torch.tensor([0.0, 1.0, 2.0, 4.0], dtype=torch.float64)
FRAGMENTS = Fragments(
    which=torch.arange(4),
    place=torch.tensor([3, 2 * SIDE**2 + 5, 2 * SIDE**2 + 5, 2 * SIDE**2]),
    depth=torch.tensor([0.2, 1.25, 3.5, 4.0], dtype=torch.float64),
)
LIGHT = torch.tensor([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]])


def dense(images: Tiled) -> torch.Tensor:
    """Of all tiles and nodes: [tile, node, k, y, x]."""
    found = torch.zeros(TILES, len(NODES), *images.values.shape[1:])
    for values, tile, node in zip(images.values, images.tile.tolist(), images.node.tolist(), strict=True):
        found[tile, node] = values
    return found


def test_light_lies_at_the_nearest_node_of_its_tile():
    images = at_nodes(FRAGMENTS, LIGHT, NODES, SOME, shared=False)
    wanted = torch.zeros(TILES, len(NODES), 2, SIDE, SIDE)
    for tile, node, y, x, fragment in ((0, 0, 0, 3, 0), (2, 1, 1, 1, 1), (2, 3, 1, 1, 2), (2, 3, 0, 0, 3)):
        wanted[tile, node, :, y, x] += LIGHT[:, fragment]
    assert torch.equal(dense(images), wanted)
    assert len(images.tile) == 3, "pairs where nothing lies are left out"
    assert images.node.tolist() == sorted(images.node.tolist())


def test_shared_light_lies_at_the_two_nodes_around_it():
    found = dense(at_nodes(FRAGMENTS, LIGHT, NODES, SOME, shared=True))
    torch.testing.assert_close(found[0, :2, 0, 0, 3], torch.tensor([0.8, 0.2]))
    torch.testing.assert_close(found[2, :, 1, 1, 1], torch.tensor([0.0, 4.5, 1.5 + 1.75, 5.25]))
    torch.testing.assert_close(found.sum((0, 1, 3, 4)), LIGHT.sum(1))


@pytest.mark.parametrize("alike", [False, True])
def test_sums_over_nodes_are_those_of_all_pairs(alike: bool):
    images = at_nodes(FRAGMENTS, LIGHT, NODES, SOME, shared=True)
    weights = torch.rand(len(NODES), 2, 2, SIDE, SIDE, generator=torch.Generator().manual_seed(0))
    wanted = torch.einsum("nckyx,tnkyx->tcyx", weights, dense(images))
    if alike:  # each channel has light of its own
        weights = weights[:, :, :1]
        wanted = torch.einsum("ncyx,tncyx->tcyx", weights[:, :, 0], dense(images))
        images = Tiled(images.values[:, None], images.tile, images.node)
    tiles, found = images.summed(weights)
    assert tiles.tolist() == [0, 2]
    torch.testing.assert_close(found, wanted[tiles])
    assert (wanted[1] == 0).all()


def test_where_nothing_lies_there_is_one_black_image():
    nothing = Fragments(*(each[:0] for each in (FRAGMENTS.which, FRAGMENTS.place, FRAGMENTS.depth)))
    spectra = at_nodes(nothing, LIGHT[:, :0], NODES, SOME, shared=True).transformed()
    assert spectra.values.shape == (1, 2, SIDE, SIDE // 2 + 1) and not spectra.values.any()


def test_what_covers_a_tile_dims_what_lies_behind_it_there():
    """OTFs that are the same at all frequencies dim what covers, and do not spread it."""
    there = ((0, 0, 0.5), (0, 3, 0.25), (2, 1, 0.75), (2, 2, 1.0), (2, 3, 0.125))
    dims = torch.tensor([1.0, 0.5, 0.25, 0.75])
    cover = torch.tensor([value for *_, value in there])[:, None, None, None].expand(-1, 1, SIDE, SIDE)
    tile, node = (torch.tensor(each) for each in list(zip(*there, strict=True))[:2])
    order = node.argsort(stable=True)
    otfs = torch.complex(dims, torch.zeros(4))[:, None, None].expand(4, SIDE, SIDE // 2 + 1)
    cuts = torch.tensor([0.5, 3.0], dtype=torch.float64)  # node 0; nodes 1 and 2; node 3
    found = passing(Tiled(cover[order], tile[order], node[order]), otfs, NODES, cuts, TILES).passed
    wanted = torch.ones(3, TILES)
    wanted[0, 0] = wanted[1, 0] = 1 - 0.25 * 0.75
    wanted[1, 2] = 1 - 0.125 * 0.75
    wanted[0, 2] = wanted[1, 2] - (0.75 * 0.5 + 1.0 * 0.25)
    torch.testing.assert_close(found, wanted[:, :, None, None].expand(-1, -1, SIDE, SIDE))


def test_tiles_that_have_most_are_chosen_for_certain():
    """A lamp that outshines another does not leave it out: what is left is shared among the rest."""
    amounts = np.array([[1.0] * 8, [900.0, 90.0, 2.0, 2.0, 2.0, 2.0, 2.0, 0.0], [0.0] * 8])
    chance = _chances(amounts, 4)
    assert chance[:2].tolist() == [1, 1] and chance.sum() == pytest.approx(4)
    assert 0 < chance[7] < chance[2] < 1
    assert _chances(amounts, 8).tolist() == [1] * 8
