"""Wiener deconvolution of edofsim, which knows the PSFs of all depths."""

from benchopt import BaseSolver

from edofsim.restore import wiener

NOISE = 0.005
"""Read noise, full scale 1."""


class Solver(BaseSolver):
    name = "wiener"
    sampling_strategy = "run_once"
    requirements = ("pip::edofsim[data]",)

    def set_objective(self, photos):
        self.photos = photos

    def run(self, _):
        self.images = [wiener(photo, psfs, NOISE) for photo, psfs in self.photos]

    def get_result(self):
        return {"images": self.images}
