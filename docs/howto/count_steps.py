"""Work and speed of a joint training of a mask and a U-Net: python count_steps.py DEVICE WIDTH"""

import contextlib
import sys
import tempfile
import time

import torch
from learn_mine import Cubic, Pictures, UNet, loss
from torch.utils.flop_counter import FlopCounterMode

import edofsim
from edofsim.learn import fit


def spent(device, width, steps, mode=None):
    """Seconds of a training: of one thread of the processor on a CPU, by the clock on a GPU."""
    clock = time.process_time if device == "cpu" else time.perf_counter
    with tempfile.TemporaryDirectory() as out, mode or contextlib.nullcontext():
        how = {"mask": Cubic(), "loss": loss, "patch_px": 128, "device": device, "out": out}
        began = clock()
        fit(edofsim.camera(window=64), UNet(width), Pictures(), steps=steps, **how)
    return clock() - began


def work(device, width):
    """GFLOP of a step."""
    found = []
    for few in (1, 1, 2):  # the first keeps PSFs that the others need as well
        counter = FlopCounterMode(display=False)
        spent(device, width, few, counter)
        found.append(counter.get_total_flops() / 1e9)
    return found[2] - found[1]


def main(device, width, steps=20):
    torch.set_num_threads(1)
    step = work(device, width)
    seconds = (spent(device, width, steps + 1) - spent(device, width, 1)) / steps
    print(f"{step:.2f} GFLOP a step, {1 / seconds:.3g} steps a second, {step / seconds:.3g} GFLOP/s")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
