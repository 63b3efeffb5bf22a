"""Restored photos of a benchmark against their all-in-focus images, as benchopt compares solvers."""

from benchopt import BaseObjective

from edofsim.restore.scores import score


class Objective(BaseObjective):
    name = "Extended depth of field (edofsim)"
    min_benchopt_version = "1.6"
    sampling_strategy = "run_once"
    requirements = ("pip::edofsim[data]",)

    def set_data(self, samples):
        """samples: dicts of `photo`, `ideal` [3, y, x] and `psfs` [depth, 3, y, x], as of `Pairs`."""
        self.samples = samples

    def get_objective(self):
        return {"photos": [(sample["photo"], sample["psfs"]) for sample in self.samples]}

    def evaluate_result(self, images):
        """images: restored photos [3, y, x], in order. PSNR and SSIM in the mean, with the noise of the
        rendering in them: `edofsim benchmark score` takes that out."""
        pairs = zip(images, self.samples, strict=True)
        scores = [score(image, sample["ideal"]) for image, sample in pairs]
        psnr = sum(score.psnr_db for score in scores) / len(scores)
        return {"value": -psnr, "psnr_db": psnr, "ssim": sum(score.ssim for score in scores) / len(scores)}

    def get_one_result(self):
        return {"images": [sample["photo"] for sample in self.samples]}

    def save_final_results(self, images):
        return None
