"""The benchmark of a training step measures what it says."""

from __future__ import annotations

import pytest

from benchmarks import learn as bench_learn


@pytest.mark.slow
def test_the_benchmark_gives_its_figures() -> None:
    """Shares are shares, and short runs in both precisions end near each other."""
    figures = bench_learn.run(patch_px=48, short_steps=20, short_patch_px=32, device="cpu")
    for precision in ("float32", "bfloat16"):
        assert figures[f"learn.seconds_per_step.{precision}"] > 0
        assert 0 < figures[f"learn.optics_share.{precision}"] <= 1
    assert abs(figures["learn.bfloat16_psnr_change_db"]) < 1
