"""The experiments of the paper and ours, each in a file. To add one: a file, and a line in `EXPERIMENTS`.

The file holds a function `run(folder, progress, ...)` whose further parameters are the options of
`edofsim evaluate NAME`, annotated as Typer wants them, and whose docstring is its help. It writes into the
folder and returns `Findings`. Decorated with `in_paper`, it is part of `edofsim evaluate paper` too. Another
package adds one by an entry point of the group `edofsim.experiments`, `NAME = "package.module:run"`.
"""

from collections.abc import Callable
from types import FunctionType
from typing import TYPE_CHECKING, TypeVar

from ..core.registry import Registry

if TYPE_CHECKING:
    from .experiment import Findings
T = TypeVar("T")


class _Experiments(Registry[T]):
    """Of a module that is only tried, functions that return `Findings`."""

    def names_of(self, thing: object) -> tuple[str, ...]:
        """Its own name, or its module's where it is called `run`."""
        run = getattr(thing, "run", thing)
        given = getattr(run, "__annotations__", {}).get("return")
        if not isinstance(run, FunctionType) or getattr(given, "__name__", given) != "Findings":
            return ()
        name = run.__module__.rpartition(".")[2] if run.__name__ == "run" else run.__name__
        return (name.replace("_", "-"),)


EXPERIMENTS: "Registry[Callable[..., Findings]]" = _Experiments(
    "edofsim.experiments",
    "experiment",
    {
        "bandwidth": "edofsim.experiments.bandwidth:run",
        "mtf": "edofsim.experiments.mtf:run",
        "table": "edofsim.experiments.table:run",
        "cameras": "edofsim.experiments.cameras:run",
        "noise": "edofsim.experiments.noise:run",
        "fabrication": "edofsim.experiments.fabrication:run",
        "broadband": "edofsim.experiments.broadband:run",
        "scene3d": "edofsim.experiments.scene3d:run",
        "bench-scene": "edofsim.experiments.bench_scene:run",
        "occlusion": "edofsim.experiments.occlusion:run",
        "predictions": "edofsim.experiments.predictions:run",
        "tolerances": "edofsim.experiments.tolerances:run",
        "stability": "edofsim.experiments.stability:run",
        "bench": "edofsim.experiments.bench:run",
    },
    "collections.abc:Callable",
)

__all__ = ["EXPERIMENTS"]
