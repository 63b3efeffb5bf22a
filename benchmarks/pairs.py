"""What ten thousand pairs to train on cost, by a hundred of them, and how fast a training reads them.

`python -m benchmarks.pairs [RECIPE] [--out DIR] [--json FILE]` makes the data set of `pairs.toml` (ten
minutes of one core) as `edofsim dataset make` does, keeps its pairs in each way that there is, and reads them
by `edofsim.data.Pairs`, and by WebDataset's own loader. Where the pairs are there, it only reads.

Figures, a pair: `core_seconds.{render,photos}`, `packing_seconds.KIND`, `bytes.KIND`; `pairs_per_second.KIND`
that one core reads from memory. Of 10,000 pairs: `core_hours`, `hours.N` on N workers of one core each,
`gib.KIND`. `workers.half`: with this number the packing, which one process does, takes as long as all else.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from edofsim.cli import invoke
from edofsim.core.files import write_text
from edofsim.data import Pairs
from edofsim.data.kept import ABOUT, PACKS, Folder, about, needed, read_sample, write_sums
from edofsim.record import record, write_record

WANTED = 10_000
WORKERS = (1, 2, 8, 16, 64, 256)
PASSES = 3


def made(recipe: Path, out: Path) -> dict[str, float]:
    """Figures of `edofsim dataset make`, which makes what is missing."""
    said = out.with_suffix(".json")
    if not said.is_file():
        invoke(["dataset", "make", str(recipe), "--out", str(out), "--json", str(said)])
    return json.loads(said.read_text())["figures"]


def kept_as(kind: str, source: Path, place: Path) -> float:
    """Keep a data set's pairs in another way; the seconds of the processor that it took."""
    content = about(source)
    content["recipe"]["store"]["kind"] = kind
    write_text(place / ABOUT, json.dumps(content))
    for name in ("cameras", "index", *(["samples"] if kind in ("folder", "png") else [])):
        shutil.copytree(source / name, place / name)
    blocks: dict[str, list[str]] = {}
    for name in content["blocks"]:
        lines = (source / "index" / f"{name}.jsonl").read_text().splitlines()
        blocks[name] = [json.loads(line)["key"] for line in lines]
    began = time.process_time()
    folder = Folder(place, blocks)
    for name, keys in blocks.items():
        PACKS[kind](folder, name, [(k, *read_sample(source / "samples" / f"{k}.exr")) for k in keys])
    write_sums(place)
    return time.process_time() - began


def read_by_webdataset(place: Path) -> Callable[[], Iterable[object]]:
    """WebDataset's own loader, which reads every plane of each pair."""
    webdataset = needed("webdataset")
    tars = sorted(str(path) for path in place.glob("train-*.tar"))
    return lambda: webdataset.WebDataset(tars, shardshuffle=False).decode()


def rate(read: Callable[[], Iterable[object]]) -> float:
    """Pairs a second of the processor, the files in memory: the best of some passes."""
    found = []
    for _ in range(1 + PASSES):
        began = time.process_time()
        count = sum(1 for _ in read())
        found.append(count / (time.process_time() - began))
    return max(found[1:])


def measured(recipe: Path, out: Path) -> dict[str, float]:
    """All figures, see the top."""
    figures = made(recipe, out)
    each = {name: figures[f"core_seconds.{name}"] / figures["pairs.made"] for name in ("render", "photos")}
    found = {f"core_seconds.{name}": value for name, value in each.items()}
    packing = {}
    for kind in PACKS:
        with TemporaryDirectory(dir=out.parent) as folder:
            place = Path(folder)
            packing[kind] = kept_as(kind, out, place) / figures["pairs"]
            pairs = Pairs(place)
            found[f"packing_seconds.{kind}"] = packing[kind]
            size = sum(file.stat().st_size for file in place.rglob("*") if file.is_file())
            found[f"bytes.{kind}"] = size / len(pairs)
            found[f"gib.{kind}"] = WANTED * size / len(pairs) / 2**30
            found[f"pairs_per_second.{kind}"] = rate(
                lambda pairs=pairs: (pairs[i] for i in range(len(pairs)))
            )
            if kind == "webdataset":
                found["pairs_per_second.webdataset.own"] = rate(read_by_webdataset(place))
    work, alone = sum(each.values()), packing["webdataset"]
    found["core_hours"] = WANTED * (work + alone) / 3600
    found |= {f"hours.{n}": WANTED * (work / n + alone) / 3600 for n in WORKERS}
    return found | {"workers.half": work / alone, "pairs": figures["pairs"]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pairs")
    parser.add_argument("recipe", nargs="?", type=Path, default=Path(__file__).with_suffix(".toml"))
    parser.add_argument("--out", type=Path, default=Path("out/hundred-pairs"))
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    by_name = measured(asked.recipe, asked.out)
    print("\n".join(f"{name:40} {value:.4g}" for name, value in by_name.items()))
    if asked.json:
        typed = shlex.join(["python", "-m", "benchmarks.pairs", *sys.argv[1:]])
        write_record(asked.json, record("pairs", figures=by_name, typed=typed))
