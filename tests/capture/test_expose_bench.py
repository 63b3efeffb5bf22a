"""The benchmark of photos, small: what it calls brute force is compared with what it calls low rank."""

from __future__ import annotations

import pytest
import torch

from benchmarks import photos as bench_expose
from edofsim.experiments.kept import Kept


def test_low_rank_against_brute_force_on_a_small_view():
    camera = bench_expose.cameras()["clear"]
    view = bench_expose.synthetic_view(48, 3, camera.pixel_angle, margin=64)
    said = []
    found = bench_expose.against_brute(view, camera, lambda fraction, text: said.append(text), depths=20)
    for tolerance in ("50db", "40db"):
        # noise in every pixel is harder than the photographs that the prior expects
        assert found["psnr_db", tolerance] > float(tolerance[:2]) - 8
    assert found["rank", "50db"] > found["rank", "40db"]
    assert 10 < found["brute_depths", ""] <= 20
    assert said[0].startswith("brute force")


def test_finished_pieces_are_not_measured_again(tmp_path, monkeypatch):
    """Unless the code has changed."""
    calls = []

    def measure():
        calls.append(1)
        return {"figure": 2.0}

    kept = Kept(tmp_path / "pieces.jsonl")
    for _ in range(2):
        assert bench_expose._once(kept, "piece", measure) == {"figure": 2.0}
    assert len(calls) == 1
    bench_expose._once(kept, "another", measure)
    monkeypatch.setattr(bench_expose, "code_of", lambda folder: "a line was changed")
    bench_expose._once(kept, "piece", measure)
    assert len(calls) == 3


def test_plot_of_growth(tmp_path):
    figures = {f"growth.{name}.{n}": float(n) for name in ("depths", "bands", "pixels") for n in (1, 2)}
    figures |= {"growth.tolerance_db.30": 1.0, "growth.tolerance_db.40": 1.4}
    figures |= {"growth_rank.30": 5.0, "growth_rank.40": 9.0}
    path = bench_expose.plot(figures, tmp_path / "cost.png")
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_interrupted_brute_force_is_gone_on_with(tmp_path, monkeypatch):
    """Killed after the second block of depths, it does the other blocks alone and gives the same photo."""
    monkeypatch.setattr(bench_expose, "BLOCK", 3)
    camera = bench_expose.cameras()["clear"]
    view = bench_expose.synthetic_view(16, 1, camera.pixel_angle, margin=64)
    nodes = torch.linspace(0, 2, 9, dtype=torch.float64)
    weights = torch.ones(1, 1, dtype=torch.float64)

    def photo(kept, stop=None):
        blocks = []

        def say(fraction, text):
            blocks.append(text)
            if len(blocks) == stop:
                raise KeyboardInterrupt

        found, figures = bench_expose._by_brute_force(view, camera, weights, nodes, say, kept)
        return found, figures, blocks

    whole, _, blocks = photo(None)
    assert len(blocks) == 3
    kept = tmp_path / "half"
    with pytest.raises(KeyboardInterrupt):
        photo(kept, stop=3)
    again, figures, blocks = photo(kept)
    assert len(blocks) == 1
    assert torch.allclose(again, whole, atol=1e-12)
    assert figures["seconds_brute", ""] > 0
