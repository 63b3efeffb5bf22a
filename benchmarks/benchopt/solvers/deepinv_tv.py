"""Total variation by deepinv, as `edofsim benchmark score deepinv-tv` takes it."""

from benchopt import BaseSolver

from edofsim.benchmark.by_deepinv import deepinv_tv


class Solver(BaseSolver):
    name = "deepinv-tv"
    sampling_strategy = "run_once"
    requirements = ("pip::edofsim[benchmark,data]",)

    def set_objective(self, photos):
        self.photos = photos

    def run(self, _):
        self.images = [deepinv_tv(photo, psfs, None) for photo, psfs in self.photos]

    def get_result(self):
        return {"images": self.images}
