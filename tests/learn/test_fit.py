"""Learning in Python: any network, mask, loss and data, by the loop of the command `train`."""

from __future__ import annotations

import os
import runpy
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset, TensorDataset

import edofsim
from edofsim.errors import InputError
from edofsim.learn import FreeHeight, evaluate, fit, trainer
from edofsim.recipe.camera import CameraRecipe, PsfSettings
from edofsim.restore.checkpoint import load_arrays, load_checkpoint
from edofsim.restore.network import apply_network

MODULE = """
from torch import nn

from edofsim.learn import fit  # for its own script: the package is imported on the way to its plugins

class Sharper(nn.Module):
    def __init__(self, width=4):
        super().__init__()
        self.width = width
        layers = nn.Conv2d(3, width, 3, padding=1), nn.ReLU(), nn.Conv2d(width, 3, 3, padding=1)
        self.layers = nn.Sequential(*layers)

    def forward(self, photo):
        return photo + self.layers(photo)
"""


class Sharper(nn.Module):
    """Hers: nothing of edofsim is in it."""

    def __init__(self, width: int = 4) -> None:
        super().__init__()
        self.width = width
        layers = (nn.Conv2d(3, width, 3, padding=1), nn.ReLU(), nn.Conv2d(width, 3, 3, padding=1))
        self.layers = nn.Sequential(*layers)

    def forward(self, photo: Tensor) -> Tensor:
        return photo + self.layers(photo)


class Cubic(nn.Module):
    """A height map of two weights, [n, n] in metres."""

    def __init__(self, samples: int = 32) -> None:
        super().__init__()
        across = torch.linspace(-1, 1, samples)
        self.register_buffer(
            "terms", torch.stack([across**3 - across.flip(0)[:, None] ** 3, across**2 + across[:, None] ** 2])
        )
        self.weights = nn.Parameter(torch.tensor([0.4, 0.0]))

    def forward(self) -> Tensor:
        return (self.weights[:, None, None] * self.terms).sum(0) * 1e-6


class Noisy(Dataset):
    """Pairs whose photos are their ideal images, with noise of a known standard deviation."""

    def __init__(self, deviation: float) -> None:
        self.deviation = deviation

    def __len__(self) -> int:
        return 6

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        if not 0 <= index < 6:
            raise IndexError(index)
        generator = torch.Generator().manual_seed(index)
        ideal = 0.2 + 0.6 * torch.rand(3, 48, 64, generator=generator)
        return {"photo": ideal + self.deviation * torch.randn(3, 48, 64, generator=generator), "ideal": ideal}


@pytest.fixture
def camera() -> edofsim.Camera:
    psf = PsfSettings(window_px=16, oversampling=1, pupil_sampling_um=21.0)
    return edofsim.Camera.from_recipe(CameraRecipe(name="hers", psf=psf))


def images(count: int = 6) -> TensorDataset:
    generator = torch.Generator().manual_seed(7)
    coarse = torch.rand(count, 3, 12, 12, generator=generator)
    return TensorDataset(nn.functional.interpolate(coarse, scale_factor=5))


SMALL = {"steps": 4, "batch": 2, "patch_px": 32, "device": "cpu", "precision": "float32"}


def squared(restored: Tensor, ideal: Tensor) -> Tensor:
    return (restored - ideal).square().mean()


def test_network_mask_and_loss_of_her_own_learn_together(camera: edofsim.Camera, tmp_path: Path) -> None:
    """The checkpoint holds what learned: the same height map, and a network that restores the same."""
    torch.manual_seed(0)
    network, mask = Sharper(width=5), Cubic()
    before = mask.weights.detach().clone(), network.layers[0].weight.detach().clone()
    done = fit(camera, network, images(), mask=mask, loss=squared, out=tmp_path / "out", **SMALL)
    assert done.finished and done.figures["steps"] == 4
    assert not torch.equal(mask.weights, before[0]) and not torch.equal(network.layers[0].weight, before[1])
    assert {"psnr_db.start", "psnr_db.validation"} <= done.figures.keys()
    checkpoint = load_checkpoint(done.checkpoint, camera.recipe)
    assert torch.equal(checkpoint.height, mask().detach())
    assert checkpoint.sampling == pytest.approx(2 * camera.aperture_radius / 32)
    assert checkpoint.network.settings() == {"of": f"{__name__}:Sharper", "settings": {"width": 5}}
    photo = torch.rand(3, 41, 50)
    with torch.no_grad():
        wide = nn.functional.pad(photo[None], (0, 14, 0, 23), mode="replicate")
        expected = network.eval()(wide)[0, :, :41, :50]
        found = checkpoint.network.unclamped(photo[None])[0]
    assert torch.allclose(found, expected, atol=1e-6)
    assert apply_network(checkpoint.network, photo).shape == photo.shape
    how = {"count": 2, "patch_px": 32}
    hers = evaluate(network, camera.with_height(mask().detach()), images(), **how)
    saved = evaluate(done.checkpoint, camera, images(), **how)
    assert hers.psnr_db == pytest.approx(saved.psnr_db, abs=1e-4)


def test_the_loss_is_the_one_that_is_given(camera: edofsim.Camera, tmp_path: Path) -> None:
    """Of a loss of nothing no weight moves but by decay; the mask by the light that it throws out."""
    network = Sharper()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    with pytest.raises(InputError, match="one number"):
        fit(camera, network, images(), loss=lambda a, b: a - b, out=tmp_path / "a", **SMALL)
    fit(camera, network, images(), loss=lambda a, b: 0 * (a - b).sum(), out=tmp_path / "b", **SMALL)
    assert all(torch.allclose(value, before[name], atol=2e-2) for name, value in network.state_dict().items())
    seen: list[tuple[int, ...]] = []

    def counting(restored: Tensor, ideal: Tensor) -> Tensor:
        seen.append(tuple(restored.shape))
        return squared(restored, ideal)

    fit(camera, Sharper(), images(), loss=counting, out=tmp_path / "c", **SMALL)
    assert seen.count((2, 3, 32, 32)) >= SMALL["steps"]


def test_an_interrupted_fit_ends_bit_for_bit_the_same(
    camera: edofsim.Camera, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(out: str, resume: bool = False):
        torch.manual_seed(3)
        network = Sharper()
        done = fit(camera, network, images(), mask=Cubic(), resume=resume, out=tmp_path / out, **SMALL)
        return done, network

    straight, network = start("straight")
    with monkeypatch.context() as patch:
        real, count = trainer.draw_batch, iter(range(100))

        def stopping(*arguments: object) -> object:
            if next(count) == 2:
                os.kill(os.getpid(), signal.SIGINT)
            return real(*arguments)

        patch.setattr(trainer, "draw_batch", stopping)
        first, _ = start("parts")
    assert not first.finished
    second, again = start("parts", resume=True)
    assert second.finished
    assert all(torch.equal(value, again.state_dict()[name]) for name, value in network.state_dict().items())
    states = [
        load_arrays(tmp_path / name / "state.safetensors", "state")[0] for name in ("straight", "parts")
    ]
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])
    psf = PsfSettings(window_px=8)
    other = edofsim.Camera.from_recipe(camera.recipe.model_copy(update={"psf": psf}))
    with pytest.raises(InputError, match=r"another \[camera\]"):
        fit(other, Sharper(), images(), mask=Cubic(), resume=True, out=tmp_path / "parts", **SMALL)


def test_pairs_are_trained_on_as_they_are(camera: edofsim.Camera, tmp_path: Path) -> None:
    """No noise is added: of noise of 0.005, the photos are 46.02 dB from their ideal images."""
    network = Sharper()
    done = fit(camera, network, Noisy(0.005), out=tmp_path / "out", **SMALL)
    expected = -20 * torch.tensor(0.005).log10()
    assert done.figures["psnr_db.validation_photo"] == pytest.approx(float(expected), abs=0.15)
    with pytest.raises(InputError, match="taken already"):
        fit(camera, network, Noisy(0.005), mask=Cubic(), out=tmp_path / "other", **SMALL)


def test_what_a_network_restores_is_scored_as_in_use(camera: edofsim.Camera) -> None:
    """Through a lens that nothing is blurred by, grey images differ from photos by noise alone."""
    grey = TensorDataset(torch.full((3, 3, 64, 64), 0.5))
    how = {"patch_px": 64, "read_noise": 0.02, "inverse_depth_per_m": (0.6, 0.75)}
    found = evaluate(nn.Identity(), camera, grey, count=3, **how)
    noise = -20 * torch.tensor(0.02).log10()
    assert found.photo_psnr_db == pytest.approx(float(noise), abs=0.1)
    assert found.psnr_db == pytest.approx(found.photo_psnr_db, abs=0.1)
    assert 0 < found.ssim < 1 and len(found.scores) == 3
    sharp = evaluate("wiener", camera, images(), count=1, **{**how, "patch_px": 48})
    assert len(sharp.scores) == 1 and sharp.psnr_db > sharp.photo_psnr_db


def test_a_checkpoint_is_read_where_its_class_is_and_refused_elsewhere(
    camera: edofsim.Camera, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "hers_alone.py").write_text(MODULE)
    monkeypatch.syspath_prepend(str(tmp_path))
    hers_alone = import_module("hers_alone")

    done = fit(camera, hers_alone.Sharper(width=3), images(), out=tmp_path / "out", **SMALL)
    for _ in range(2):
        assert load_checkpoint(done.checkpoint).network.network.width == 3
    monkeypatch.delitem(sys.modules, "hers_alone")
    with pytest.raises(InputError, match="set EDOFSIM_PLUGINS=hers_alone") as caught:
        load_checkpoint(done.checkpoint)
    assert len(caught.value.problems) == 1
    code = f"from edofsim.restore.checkpoint import load_checkpoint as load; load({str(done.checkpoint)!r})"
    how = {"cwd": tmp_path, "env": {**os.environ, "EDOFSIM_PLUGINS": "hers_alone"}}
    subprocess.run([sys.executable, "-c", code], check=True, **how)


def test_no_file_has_a_function_called(tmp_path: Path) -> None:
    """A checkpoint that names something else than a network's class is refused, and it is not called."""
    from edofsim.restore.own_network import OwnNetwork

    for named in ("os:system", "pathlib:Path", "torch:nothing", "torch.nn:functional"):
        with pytest.raises(InputError, match=r"no class of torch\.nn\.Module"):
            OwnNetwork(named, {"command": "touch here"})


class Gives(nn.Module):
    """A network that gives what it is asked to."""

    def __init__(self, what: str = "none") -> None:
        super().__init__()
        self.what, self.scale = what, nn.Parameter(torch.ones(()))

    def forward(self, photo: Tensor) -> object:
        return {"none": None, "grey": photo[:, :1], "small": photo[..., ::2]}[self.what]


class Heights(nn.Module):
    def __init__(self, given: object) -> None:
        super().__init__()
        self.given = given

    def forward(self) -> object:
        return self.given


class Asks(nn.Module):
    def __init__(self, other: nn.Module) -> None:
        super().__init__()
        self.other = other


@pytest.mark.parametrize("what", ["none", "grey", "small"])
def test_networks_that_give_no_image_are_refused(what: str, camera: edofsim.Camera, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="images of the same shape"):
        fit(camera, Gives(what), images(), out=tmp_path / "out", **SMALL)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"network": "paper-dcnn"}, "give a torch.nn.Module"),
        ({"network": Asks(nn.Identity())}, "settings="),
        ({"network": nn.Sequential(nn.Conv2d(3, 3, 1))}, "settings="),
        ({"data": 3}, "give a folder of pictures"),
        ({"data": "no/such/folder"}, "no such folder"),
        ({"data": TensorDataset(torch.rand(4, 1, 64, 64))}, r"give images as tensors \[3, y, x\]"),
        ({"data": TensorDataset(torch.rand(4, 3, 64, 20))}, "fewer than a patch of 32"),
        ({"data": TensorDataset(torch.rand(1, 3, 64, 64))}, "at least two"),
        ({"mask": Heights(None)}, "mask gives nothing"),
        ({"mask": Heights({"heights": torch.zeros(4, 4)})}, "mask gives heights: Tensor"),
        ({"mask": Heights({"amplitude": torch.full((4, 4), 2.0)})}, "from 0"),
        ({"mask": Heights(torch.zeros(3, 4))}, "square"),
        ({"mask": Heights(torch.ones(4, 4))}, "in metres"),
        ({"steps": 0}, "steps"),
        ({"inverse_depth_per_m": (2.0, 1.0)}, "ascend"),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_sentence(
    changes: dict, said: str, camera: edofsim.Camera, tmp_path: Path
) -> None:
    given = {"network": Sharper(), "data": images(), "out": tmp_path / "out", **SMALL, **changes}
    with pytest.raises(InputError, match=said):
        fit(camera, given.pop("network"), given.pop("data"), **given)


class Apodised(nn.Module):
    """A cubic relief behind a Gaussian apodiser, both of which learn."""

    def __init__(self, height: bool) -> None:
        super().__init__()
        self.relief, self.waist = Cubic() if height else None, nn.Parameter(torch.tensor(0.8))

    def forward(self) -> dict[str, Tensor]:
        across = torch.linspace(-1, 1, 24)
        amplitude = torch.exp(-(across**2 + across[:, None] ** 2) / self.waist**2)
        return {"amplitude": amplitude} | ({"height": self.relief()} if self.relief is not None else {})


@pytest.mark.parametrize("height", [True, False])
def test_an_amplitude_learns_alone_and_beside_heights(
    height: bool, camera: edofsim.Camera, tmp_path: Path
) -> None:
    """The checkpoint has both, and the camera that it gives is the one that learned."""
    mask = Apodised(height)
    done = fit(camera, Sharper(), images(), mask=mask, out=tmp_path / "out", **SMALL)
    assert mask.waist.item() != pytest.approx(0.8, abs=1e-4)
    checkpoint = load_checkpoint(done.checkpoint, camera.recipe)
    assert torch.equal(checkpoint.amplitude, mask()["amplitude"].detach())
    assert (checkpoint.height is not None) == height
    made = edofsim.camera(network=done.checkpoint)
    assert torch.equal(made.amplitude, checkpoint.amplitude)
    assert made.recipe.mask.kind == ("height-map" if height else "clear")
    how = {"count": 1, "patch_px": 32}
    saved = evaluate(done.checkpoint, camera, images(), **how)
    open_wide = evaluate(checkpoint.network, camera, images(), **how)
    assert saved.photo_psnr_db != pytest.approx(open_wide.photo_psnr_db, abs=1e-3)


def test_a_loader_s_images_and_a_free_height_map(camera: edofsim.Camera, tmp_path: Path) -> None:
    """8-bit images count as those of full scale 1."""
    eight = TensorDataset((images()[:][0] * 255).round().to(torch.uint8))
    mask = FreeHeight(torch.full((24, 24), 0.6e-6), 1.2e-6, 1e-7)
    done = fit(camera, Sharper(), DataLoader(eight), mask=mask, out=tmp_path / "a", **SMALL)
    assert load_checkpoint(done.checkpoint).height.shape == (24, 24)
    torch.manual_seed(1)
    one = evaluate(nn.Identity(), camera, eight, count=2, patch_px=32)
    other = evaluate(nn.Identity(), camera, images(), count=2, patch_px=32)
    assert one.psnr_db == pytest.approx(other.psnr_db, abs=0.1)


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The script of the page, as a module; its pictures are read once."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "docs" / "howto"))
    module = import_module("learn_mine")
    read = list(module.Pictures())
    monkeypatch.setattr(module.Pictures, "__getitem__", lambda self, index: read[index])
    yield module
    for name in ("learn_mine", "first_training"):
        sys.modules.pop(name, None)


@pytest.fixture
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cameras of scripts have small PSFs."""
    whole = edofsim.camera
    monkeypatch.setattr(edofsim, "camera", lambda *given, **how: whole(*given, **{**how, "window": 16}))


def test_a_first_training_takes_thirty_lines(
    page: ModuleType,
    narrow: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Blank ones are not counted. They run, and what they leave is read where their classes are."""
    script = Path(page.__file__ or "").with_name("first_training.py")
    assert sum(map(bool, script.read_text(encoding="utf-8").splitlines())) <= 30
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(script), "1"])
    runpy.run_path(str(script), run_name="__main__")
    said = capsys.readouterr().out
    assert "psnr_db.start" in said and "psnr_db.validation" in said
    checkpoint = load_checkpoint(tmp_path / "out" / "fit" / "fit.safetensors")
    assert checkpoint.network.settings()["of"] == "first_training:UNet"
    start, learned = page.Cubic()().detach(), checkpoint.height
    assert not torch.equal(learned, start) and torch.allclose(learned, start, atol=1e-7)


def test_the_script_of_the_page_ends_in_its_table(
    page: ModuleType,
    narrow: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(page, "evaluate", lambda *given, **how: evaluate(*given, count=2, patch_px=64))
    page.main(1, 2)
    rows = capsys.readouterr().out.splitlines()
    assert [row[:17].strip() for row in rows] == ["lens alone", "cubic mask", "mask that learns"]
    assert all(float(row[17:].split()[0]) > 10 for row in rows)
    assert (tmp_path / "systems.svg").read_text(encoding="utf-8").count("</svg>") == 1


@pytest.mark.usefixtures("narrow")
def test_the_work_of_a_step_is_counted(page: ModuleType) -> None:
    """Twice as many channels add to it what their convolutions do: two operations a product, in the forward
    pass and twice in the backward one."""
    narrow, wide = (9 * (3 * w + w * w + 2 * w * w / 16 + 2 * w * 3) for w in (4, 8))
    count = import_module("count_steps")
    products = 4 * 128**2 * (wide - narrow)
    assert count.work("cpu", 8) - count.work("cpu", 4) == pytest.approx(6 * products / 1e9, rel=1e-3)
    sys.modules.pop("count_steps")


@pytest.mark.slow
@pytest.mark.parametrize("whose", ["page", "deepinv"])
def test_a_foreign_u_net_and_a_mask_gain_2_db_in_300_steps(
    whose: str, page: ModuleType, camera: edofsim.Camera, tmp_path: Path
) -> None:
    """On validation photos, over both as they were at the start; the network knows nothing of edofsim."""
    torch.manual_seed(0)
    settings = None
    if whose == "page":
        network = page.UNet()
    else:
        settings = {"in_channels": 3, "out_channels": 3, "scales": 2}
        network = pytest.importorskip("deepinv").models.UNet(**settings)
    how = {"steps": 300, "batch": 2, "patch_px": 48, "learning_rate": 3e-3, "mask_learning_rate": 0.01}
    near = {"inverse_depth_per_m": (0.4, 1.0), "device": "cpu", "settings": settings}
    mask = page.Cubic()
    psf = PsfSettings(window_px=32)
    wide = edofsim.Camera.from_recipe(camera.recipe.model_copy(update={"psf": psf}))
    done = fit(wide, network, page.Pictures(), mask=mask, out=tmp_path / "out", **how, **near)
    print(whose, done.figures, mask.strength.item())
    assert done.figures["psnr_db.validation"] > done.figures["psnr_db.start"] + 2
    assert mask.strength.item() != 1.0
