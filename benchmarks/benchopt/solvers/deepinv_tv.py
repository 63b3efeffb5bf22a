"""Total variation by deepinv: each colour is deconvolved by the mean of its PSFs over the depth range.

The weight is the best of three on every fourth photo of `tiny`."""

import deepinv
import torch
from benchopt import BaseSolver


class Solver(BaseSolver):
    name = "deepinv-tv"
    sampling_strategy = "run_once"
    requirements = ("pip::deepinv",)
    parameters = {"weight": [1e-3], "steps": [50]}

    def set_objective(self, photos):
        self.photos = photos

    def restored(self, photo, psfs):
        """A photo [3, y, x] without the blur of PSFs [depth, 3, y, x]."""
        mean = psfs.mean(0)[None]  # a convolution of deepinv has its middle at n // 2, as the PSFs have
        psf = mean / mean.sum((-2, -1), keepdim=True)
        physics = deepinv.physics.BlurFFT(img_size=photo.shape, filter=psf)
        model = deepinv.optim.PGD(
            prior=deepinv.optim.TVPrior(n_it_max=20),
            data_fidelity=deepinv.optim.L2(),
            stepsize=1.0,
            lambda_reg=self.weight,
            max_iter=self.steps,
        )
        with torch.no_grad():
            return model(photo[None], physics)[0]

    def run(self, _):
        self.images = [self.restored(*photo) for photo in self.photos]

    def get_result(self):
        return {"images": self.images}
