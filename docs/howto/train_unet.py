"""A U-Net that knows nothing of edofsim, trained on a data set: python train_unet.py DIR EPOCHS"""

import sys

import torch
from torch import nn
from torch.utils.data import DataLoader

from edofsim.data import Pairs


class UNet(nn.Module):
    def __init__(self, width: int = 16):
        super().__init__()
        self.first = self.block(3, width)
        self.inner = self.block(width, 2 * width)
        self.last = nn.Sequential(self.block(3 * width, width), nn.Conv2d(width, 3, 1))

    @staticmethod
    def block(inputs: int, outputs: int) -> nn.Module:
        layers = (
            nn.Conv2d(inputs, outputs, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(outputs, outputs, 3, padding=1),
        )
        return nn.Sequential(*layers, nn.ReLU())

    def forward(self, photo: torch.Tensor) -> torch.Tensor:
        fine = self.first(photo)
        coarse = nn.functional.interpolate(self.inner(nn.functional.avg_pool2d(fine, 2)), scale_factor=2)
        return photo + self.last(torch.cat([fine, coarse], 1))


folder, epochs = sys.argv[1], int(sys.argv[2])
torch.manual_seed(0)
network = UNet()
pairs = Pairs(folder, "train", crop=32, augment=True, turns=False)
optimiser = torch.optim.Adam(network.parameters(), 1e-3)
for pairs.epoch in range(epochs):
    for pair in DataLoader(pairs, batch_size=4, shuffle=True, num_workers=2):
        loss = (network(pair["photo"]) - pair["ideal"].clamp(0, 1)).abs().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
with torch.no_grad():
    for pair in DataLoader(Pairs(folder, "test")):
        error = [
            (x.clamp(0, 1) - pair["ideal"].clamp(0, 1)).square().mean()
            for x in (pair["photo"], network(pair["photo"]))
        ]
        print(pair["key"][0], *(f"{-10 * float(each.log10()):.2f} dB" for each in error))
