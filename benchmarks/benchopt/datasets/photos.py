"""Photos that `edofsim benchmark make` took."""

from benchopt import BaseDataset

from edofsim.data import Pairs


class Dataset(BaseDataset):
    name = "photos"
    requirements = ("pip::edofsim[data]",)
    parameters = {"folder": ["out/tiny"], "count": [20]}

    def get_data(self):
        pairs = Pairs(self.folder, "test", planes=("photo", "ideal"), psfs=True)
        return {"samples": [pairs[number] for number in range(min(self.count, len(pairs)))]}
